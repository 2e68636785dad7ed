//! One image to be simulated: its acquisition, its camera, its random numbers.

use super::keyed_rng::KeyedRng;
use super::sensor::Acquisition;
use crate::rpc::Rpc;
use crate::scene::Role;

/// One acquisition and its camera.
pub(super) struct SimulatedView {
    pub(super) plan: Acquisition,
    pub(super) role: Role,
    pub(super) true_rpc: Rpc,
    /// Random numbers of its radiometry, cars and noise.
    pub(super) rng: KeyedRng,
}

impl SimulatedView {
    /// The camera with its pointing error, as delivered.
    pub(super) fn delivered_rpc(&self) -> Rpc {
        let (d_col, d_row) = self.plan.pointing_error;
        self.true_rpc.shifted(d_col, d_row)
    }
}
