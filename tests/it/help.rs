//! The help: `-h` fits on a screen, `--help` has all options in groups, those of all commands last.

use crate::common::succeeds;

fn help(words: &[&str]) -> String {
    String::from_utf8(succeeds(words).stdout).unwrap()
}

/// Headings of a help, in their order.
fn headings(text: &str) -> Vec<&str> {
    text.lines().filter(|line| line.ends_with(':') && !line.starts_with(' ')).collect()
}

#[test]
fn the_usual_options_of_run_fit_on_a_screen() {
    let short = help(&["run", "-h"]);
    assert!(short.lines().count() <= 40, "{} lines:\n{short}", short.lines().count());
    for option in [
        "--output",
        "--aoi",
        "--height-range",
        "--recipe",
        "--resolution",
        "--truth",
        "--overwrite",
        "--help",
    ] {
        assert!(short.contains(option), "{option}:\n{short}");
    }
    assert!(!short.contains("--inpaint") && help(&["run", "--help"]).contains("--inpaint"));
}

#[test]
fn options_stand_in_groups_and_those_of_all_commands_last() {
    let long = help(&["run", "--help"]);
    let groups =
        ["Input:", "Matching:", "Cameras:", "Training:", "Run:", "Products:", "Scoring:", "Photographs:"];
    let found = headings(&long);
    for group in groups {
        assert!(found.contains(&group), "{group} of {found:?}");
    }
    for command in ["info", "ba", "train", "dsm", "run", "plan", "mesh", "predict", "learn", "view"] {
        let text = help(&[command, "--help"]);
        assert_eq!(
            headings(&text).iter().rfind(|h| !h.contains("xample")),
            Some(&"Options of all commands:"),
            "{text}"
        );
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 100, "{command}: {widest} columns");
    }
}
