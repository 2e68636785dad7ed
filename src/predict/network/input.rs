//! What the network computes the splats of a tile from.

use super::blocks::FeatureBlocks;

/// Number of key points that a query attends to.
pub const NEIGHBOURS: usize = 8;

/// What the network computes the splats of a tile from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkInput<T> {
    /// Of the points of the groups: [`MEMBER_INPUTS`](super::MEMBER_INPUTS) numbers for each, [`GROUP`](super::GROUP) successive items a key point.
    pub members: FeatureBlocks<T>,
    /// Of the key points: [`KEY_INPUTS`](super::KEY_INPUTS) numbers, then their image features.
    pub keys: FeatureBlocks<T>,
    /// Of the queries: the nearest key points.
    pub neighbours: Vec<[u32; NEIGHBOURS]>,
    /// Of the queries: their position relative to each of these, in units of the spacing of the key points.
    pub relative: Vec<[[T; 3]; NEIGHBOURS]>,
    /// Of the queries: [`QUERY_INPUTS`](super::QUERY_INPUTS) numbers.
    pub queries: FeatureBlocks<T>,
}
