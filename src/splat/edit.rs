//! Edits of the set of splats: densification, pruning and sorting.

/// A new set of splats in terms of the old one: `new[i]` is a copy of `old[source[i]]`.
///
/// Everything that holds a value for each splat follows: [`Splats::apply`](super::splats::Splats::apply) and
/// [`TrainingState::apply`](super::state::TrainingState::apply).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Edit {
    /// Index in the old set of the splat that each splat of the new set is copied from.
    pub source: Vec<u32>,
    /// Splats of the new set from this index on are new: their moments and statistics start at zero.
    pub fresh_from: usize,
}

impl Edit {
    /// Keeps the splats for which `keep` is true, in their order.
    #[must_use]
    pub fn retain(keep: &[bool]) -> Self {
        Self::permute((0..keep.len() as u32).filter(|i| keep[*i as usize]).collect())
    }

    /// Reorders the splats: splat `order[i]` of the old set becomes splat `i`.
    #[must_use]
    pub fn permute(order: Vec<u32>) -> Self {
        Self { fresh_from: order.len(), source: order }
    }

    /// Appends a copy of splat `source` of the old set, as a new splat.
    pub fn push_fresh(&mut self, source: u32) {
        self.source.push(source);
    }

    /// Indices of the new splats in the new set.
    pub fn fresh(&self) -> std::ops::Range<usize> {
        self.fresh_from..self.source.len()
    }

    /// Applies the edit to a vector with one value for each splat.
    pub fn gather<V: Copy>(&self, values: &mut Vec<V>) {
        *values = self.source.iter().map(|i| values[*i as usize]).collect();
    }
}
