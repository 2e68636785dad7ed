//! Colours for novel views: the second training of recipes that have one, and what is made from it.

mod scores;
mod season;
mod train;

pub(super) use scores::nvs_eval;
pub(super) use season::embedding_at;
pub(super) use train::{OtherNetworks, train_locked};
