//! What a user hands in: views (image, RPC, sun, date), and the readers that find them.

mod pixels;
mod view;

pub use view::{Role, Scene, Sun, View};
