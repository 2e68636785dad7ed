//! The page in the browser that shows a run: splats, mesh, surface, sparse points and cameras.
//!
//! [`ViewerPage`] holds the layers and their files. It is written as one file that needs nothing else
//! ([`ViewerPage::html`]), or served on the loopback interface ([`serve`]). All positions of the page are in the site frame,
//! as f32; the page adds the site's origin in f64.
//!
//! `page/` holds the page's own markup, style and program, and in `dist/` its libraries, three.js and Spark, as one script
//! that `scripts/build-viewer` makes.

mod camera_mark;
mod comparison;
mod detail;
mod error;
mod live;
mod page;
mod relief;
mod server;

pub use camera_mark::CameraMark;
pub use detail::{coarse_to_fine, parts};
pub use error::ViewerError;
pub use live::LiveState;
pub use page::{PageContent, PageFile, PageLayer, PageScope, ShownLayer, ViewerPage};
pub use relief::ReliefLayer;
pub use server::{bind, serve};
