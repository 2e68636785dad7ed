//! The examples run without arguments, on `data/town`.

#[path = "../../examples/adjust_folder.rs"]
#[allow(dead_code)]
mod adjust_folder;
#[path = "../../examples/fly_through.rs"]
#[allow(dead_code)]
mod fly_through;
#[path = "../../examples/project_point.rs"]
#[allow(dead_code)]
mod project_point;
#[path = "../../examples/rewrite_colmap.rs"]
#[allow(dead_code)]
mod rewrite_colmap;
#[path = "../../examples/score_dsm.rs"]
#[allow(dead_code)]
mod score_dsm;
#[path = "../../examples/train_dsm.rs"]
#[allow(dead_code)]
mod train_dsm;

#[test]
fn a_point_is_projected() {
    project_point::run(&[]).unwrap();
}

#[test]
fn a_folder_is_adjusted() {
    adjust_folder::run(&[]).unwrap();
}

#[test]
fn a_colmap_model_is_rewritten() {
    rewrite_colmap::run(&[]).unwrap();
}

#[test]
fn a_surface_model_is_made() {
    train_dsm::run(&[]).unwrap();
}

#[test]
fn a_surface_model_is_scored() {
    score_dsm::run(&[]).unwrap();
}

#[test]
fn an_animation_is_rendered() {
    fly_through::run(&[]).unwrap();
}
