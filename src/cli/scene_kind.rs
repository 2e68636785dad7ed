//! Which options each kind of scene uses: what a scene makes nothing of is refused by name, never passed over.

use super::CliError;
use std::collections::BTreeSet;
use std::path::Path;

/// A kind of scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneKind {
    /// Images with RPCs.
    Satellites,
    /// Images with pinhole cameras.
    Photographs,
}

/// Options that only satellite scenes use.
const OF_SATELLITES: [&str; 28] = [
    // How images and RPCs are read.
    "rpcs",
    "sun",
    "aoi",
    "bands",
    "stretch",
    "gamma",
    "trust-rpc",
    "footprints",
    "skyplot",
    // The adjustment of the RPCs.
    "height-range",
    "dem",
    "dem-vertical",
    "dem-sigma",
    "model",
    "gcps",
    "reference",
    "fixed",
    // Points of a prediction.
    "keep-place",
    // Tiles.
    "core",
    "overlap",
    "max-memory",
    // The surface model and its scores.
    "no-splats",
    "no-fill",
    "truth",
    "classes",
    "mask",
    "truth-vertical",
    "truth-crs",
];
/// Options that only photographs use.
const OF_PHOTOGRAPHS: [&str; 5] = ["georef", "test-views", "downsampling", "transparent", "reference-points"];

/// The options that were typed on the command line, by their long names.
#[derive(Clone, Debug, Default)]
pub struct Given(BTreeSet<String>);

impl Given {
    /// Those after the name of the command.
    pub fn of(program: &clap::Command, matches: &clap::ArgMatches) -> Self {
        let Some((name, matches)) = matches.subcommand() else { return Self::default() };
        let command = program.find_subcommand(name).into_iter();
        let is_typed =
            |id: &clap::Id| matches.value_source(id.as_str()) == Some(clap::parser::ValueSource::CommandLine);
        let typed = command.flat_map(clap::Command::get_arguments).filter(|option| is_typed(option.get_id()));
        // That of `satgs predict` is the file of a network, that of other commands how RPCs are corrected.
        let is_listed = |option: &&str| (name, *option) != ("predict", "model");
        Self(typed.filter_map(clap::Arg::get_long).filter(is_listed).map(str::to_owned).collect())
    }

    /// An error if one of the options is of the other kind of scenes than the one at `scene`.
    pub fn require_of(&self, kind: SceneKind, scene: &Path) -> Result<(), CliError> {
        let (others, only_for): (&[&str], _) = match kind {
            SceneKind::Satellites => (&OF_PHOTOGRAPHS, "perspective scenes"),
            SceneKind::Photographs => (&OF_SATELLITES, "satellite scenes"),
        };
        let Some(option) = others.iter().find(|option| self.0.contains(**option)) else { return Ok(()) };
        let message = format!("--{option} is for {only_for}, which `{}` is not", scene.display());
        Err(CliError::input(message, "`satgs info SCENE` without options shows what a scene is"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    /// Options that both kinds use, or about which the recipe of a training decides.
    const OF_BOTH: [&str; 29] = [
        "device",
        "devices",
        "output",
        "overwrite",
        "recipe",
        "primitive",
        "start",
        "iterations",
        "seed",
        "checkpoint-every",
        "resume",
        "snapshots",
        "features",
        "lpips",
        "depth-prior",
        "prior-kind",
        "normal-prior",
        "inpaint",
        "resolution",
        "like",
        "vertical",
        "fill",
        "hillshade",
        "dtm",
        "points",
        "mesh",
        "help",
        "json",
        "version",
    ];

    #[test]
    fn the_table_says_of_every_option_which_scenes_use_it() {
        let program = super::super::Cli::command();
        for name in ["info", "run"] {
            let command = program.find_subcommand(name).unwrap();
            for option in command.get_arguments().filter_map(clap::Arg::get_long) {
                let lists: [&[&str]; 3] = [&OF_SATELLITES, &OF_PHOTOGRAPHS, &OF_BOTH];
                let listed = lists.iter().filter(|list| list.contains(&option)).count();
                assert_eq!(listed, 1, "--{option} of `{name}` stands in {listed} lists of scene_kind.rs");
            }
        }
    }

    #[test]
    fn an_option_of_the_other_kind_is_refused_if_it_is_typed() {
        let given = |words: &[&str]| {
            let program = super::super::Cli::command();
            let matches = program.clone().try_get_matches_from(words).unwrap();
            Given::of(&program, &matches)
        };
        let (photos, scene) = (SceneKind::Photographs, Path::new("scene"));
        let usual = given(&["satgs", "run", "scene", "-o", "run", "--iterations", "5"]);
        assert!(usual.require_of(photos, scene).is_ok(), "defaults are not typed");
        assert!(usual.require_of(SceneKind::Satellites, scene).is_ok());
        for option in [["--core", "100"], ["--max-memory", "1GB"], ["--model", "affine"]] {
            let typed = given(&[["satgs", "run", "scene", "-o", "run"].as_slice(), &option].concat());
            let refusal = typed.require_of(photos, scene).unwrap_err();
            assert!(refusal.message.contains(option[0]), "{}", refusal.message);
            assert!(typed.require_of(SceneKind::Satellites, scene).is_ok());
        }
        let typed = given(&["satgs", "run", "scene", "-o", "run", "--georef", "exif"]);
        assert!(typed.require_of(SceneKind::Satellites, scene).is_err());
    }
}
