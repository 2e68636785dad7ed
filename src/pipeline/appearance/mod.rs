//! Colours for novel views: the second training of recipes that have one, and what is made from it.

mod scores;
mod season;
mod train;
mod trained;

pub(super) use scores::nvs_eval;
pub(super) use season::embedding_at;
pub(super) use train::{OtherNetworks, train_locked};
pub(super) use trained::{SceneColors, hash_of};
