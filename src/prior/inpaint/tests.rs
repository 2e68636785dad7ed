//! Commands that fill pictures, and those that fail to.

use super::*;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::progress::NoProgress;
use glam::{DMat3, DVec2, DVec3};

const SIZE: (usize, usize) = (6, 4);

fn views() -> Vec<PseudoView> {
    let (focal, principal) = (DVec2::ONE, DVec2::ZERO);
    let camera =
        PinholeCamera { cam_from_site: DMat3::IDENTITY, center: DVec3::ZERO, focal, principal, size: SIZE };
    let hole: Vec<bool> = (0..24).map(|i| i % 6 > 3).collect();
    let colors = hole.iter().map(|hole| if *hole { [0; 3] } else { [10, 20, 30] }).collect();
    let depth = Grid2::filled(SIZE.0, SIZE.1, 2.0);
    vec![PseudoView { camera, holes: 0.3, is_used: true, colors, hole, depth }]
}

/// Fills the views by a script for `sh`, with this limit in seconds; the colours of the first view.
fn fill(script: &str, limit_s: f64, folder: &Path) -> Result<Vec<[u8; 3]>, PriorError> {
    let path = folder.join("fill.sh");
    std::fs::write(&path, script).unwrap();
    let command = format!("sh '{}' {{rgb}} {{mask}} {{depth}} {{out}}", path.display());
    let mut views = views();
    let kept = folder.join("kept");
    let limit = Duration::from_secs_f64(limit_s);
    InpaintCommand::parse(&command)?.fill_within(&mut views, &kept, limit, &NoProgress)?;
    Ok(views.remove(0).colors)
}

#[test]
#[cfg(unix)]
fn only_holes_take_the_colours_of_a_command_and_a_picture_is_filled_once() {
    let folder = tempfile::tempdir().unwrap();
    let painted = folder.path().join("painted.png");
    write_png_rgb(&painted, SIZE.0, SIZE.1, &[200; 72]).unwrap();
    let count = folder.path().join("count");
    let script =
        format!("test -s $2 && test -s $3 && cp '{}' $4; echo >> '{}'", painted.display(), count.display());
    for _ in 0..2 {
        let colors = fill(&script, 60.0, folder.path()).unwrap();
        assert!(
            colors
                .iter()
                .zip(&views()[0].hole)
                .all(|(c, hole)| *c == if *hole { [200; 3] } else { [10, 20, 30] })
        );
    }
    assert_eq!(std::fs::read_to_string(count).unwrap().lines().count(), 1);
}

#[test]
#[cfg(unix)]
fn commands_that_fail_hang_or_write_another_picture_are_refused() {
    let refusal = |script: &str, limit_s: f64| {
        let folder = tempfile::tempdir().unwrap();
        write_png_rgb(&folder.path().join("small.png"), 3, 4, &[200; 36]).unwrap();
        let script = script.replace("SMALL", &folder.path().join("small.png").display().to_string());
        fill(&script, limit_s, folder.path()).unwrap_err()
    };
    let failed = refusal("echo out of memory >&2; exit 3", 60.0);
    assert!(matches!(&failed, PriorError::CommandFailed { said, .. } if said == "out of memory"), "{failed}");
    assert!(matches!(refusal("sleep 60", 0.2), PriorError::CommandTime { .. }));
    assert!(matches!(refusal("exit 0", 60.0), PriorError::CommandSilent { .. }));
    let small = refusal("cp 'SMALL' $4", 60.0).to_string();
    assert!(small.contains("has 3 x 4 pixels of 3 bands, expected 6 x 4 of three"), "{small}");
    let damaged = refusal("echo no picture > $4", 60.0).to_string();
    assert!(damaged.contains("cannot be read"), "{damaged}");
}

#[test]
fn a_command_names_picture_mask_and_output() {
    let missing = InpaintCommand::parse("paint {rgb} {out}").unwrap_err().to_string();
    assert!(missing.contains("does not name {rgb}, {mask} and {out}"), "{missing}");
    assert!(matches!(InpaintCommand::parse("paint '{rgb} {mask} {out}"), Err(PriorError::Words { .. })));
    let files = ["/a b/rgb.png", "/m.png", "/d.npy", "/o.png"].map(PathBuf::from);
    assert_eq!(filled("--in={rgb}:{mask}", &files), "--in=/a b/rgb.png:/m.png");
}
