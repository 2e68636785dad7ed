//! The arguments of every command that reads a perspective scene.

use crate::perspective::{GeoreferenceSource, PerspectiveOptions, TEST_EVERY, TestViews, Transparency};
use std::path::PathBuf;

/// How a perspective scene is read.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct PerspectiveArgs {
    /// Where the scene lies on Earth: `exif`, the GPS positions of the photographs, or a file
    ///
    /// The file is JSON with epsg, scale, rotation and translation, or a list: a line `EPSG:CODE`, then lines `image easting northing
    /// height` [default: none, the scene stays in its own frame].
    #[arg(long, value_name = "exif|FILE", value_parser = parse_georeference, hide_short_help = true, help_heading = "Photographs")]
    pub georef: Option<GeoreferenceSource>,
    /// The images.
    #[command(flatten)]
    pub images: ImageArgs,
}

/// Which images of a perspective scene are read, and how large.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct ImageArgs {
    /// Test views, which are not trained on: every N-th image, those that a file lists, or `none` [default: the scene's own list,
    /// else every 8th]
    #[arg(long, value_name = "N|FILE|none", value_parser = parse_test_views, hide_short_help = true, help_heading = "Photographs")]
    pub test_views: Option<TestViews>,
    /// Reduce images to 1/N of their width and height [default: 1]
    #[arg(long, value_name = "N", value_parser = ["1", "2", "4", "8"], hide_short_help = true, help_heading = "Photographs")]
    pub downsampling: Option<String>,
    /// Meaning of transparent pixels: `empty`, the background shows, or `unknown`, they are not compared [default: empty in
    /// transforms.json, otherwise unknown]
    #[arg(long, value_name = "MEANING", value_parser = Transparency::NAMES, hide_short_help = true, help_heading = "Photographs")]
    pub transparent: Option<String>,
}

impl PerspectiveArgs {
    /// The options of the library.
    pub fn options(&self) -> PerspectiveOptions {
        PerspectiveOptions { georeference: self.georef.clone(), ..self.images.options() }
    }
}

impl ImageArgs {
    /// The options of the library.
    pub fn options(&self) -> PerspectiveOptions {
        PerspectiveOptions {
            test_views: self.test_views.clone().unwrap_or(TestViews::Every(TEST_EVERY)),
            georeference: None,
            downsampling: self.downsampling.as_deref().and_then(|n| n.parse().ok()).unwrap_or(1),
            transparency: self.transparent.as_deref().and_then(Transparency::named),
        }
    }
}

fn parse_georeference(text: &str) -> Result<GeoreferenceSource, String> {
    Ok(if text == "exif" { GeoreferenceSource::Exif } else { GeoreferenceSource::File(text.into()) })
}

fn parse_test_views(text: &str) -> Result<TestViews, String> {
    match text.parse::<usize>() {
        Ok(0 | 1) => Err("every 2nd image or fewer can be held back".to_owned()),
        Ok(n) => Ok(TestViews::Every(n)),
        Err(_) if text == "none" => Ok(TestViews::None),
        Err(_) => Ok(TestViews::List(PathBuf::from(text))),
    }
}
