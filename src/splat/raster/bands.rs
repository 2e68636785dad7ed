//! A band: sixteen pixel rows, their tiles' lists of splats in altitude order, and each splat's gradient slot.

use super::kernel::GradientSlot;
use super::project::Chunk;
use crate::simd::Real;
use std::hint::black_box;

/// A splat in a tile's list, with all that drawing it takes: the list is read from first to last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry<T, const C: usize> {
    /// Numbers of its [`super::project::Footprint`].
    pub footprint: [T; 8],
    pub feature: [T; C],
    /// The splat's slot within the band.
    pub slot: u32,
}

/// Tiles whose lists are read ahead together: so few that they stay in a core's own cache.
const WARMED: usize = 8;

/// Tile lists and gradient slots of one band.
pub(super) struct Band<T, const C: usize> {
    /// Entries of tile `t` are `entries[tile_starts[t]..tile_starts[t + 1]]`.
    tile_starts: Vec<u32>,
    entries: Vec<Entry<T, C>>,
    /// Slots of chunk `k` begin at `chunk_slots[k]`, one a span.
    chunk_slots: Vec<u32>,
    pub slots: Vec<GradientSlot<T, C>>,
    /// Room for what the backward pass computes of each pixel.
    pub products: Vec<T>,
    /// Pairs of a splat and a pixel that the last forward pass computed.
    pub computed_pairs: usize,
}

impl<T, const C: usize> Default for Band<T, C> {
    fn default() -> Self {
        Self {
            tile_starts: Vec::new(),
            entries: Vec::new(),
            chunk_slots: Vec::new(),
            slots: Vec::new(),
            products: Vec::new(),
            computed_pairs: 0,
        }
    }
}

impl<T: Real, const C: usize> Band<T, C> {
    /// Lists the splats of every tile by counting; chunks come in rank order, so lists are in altitude order.
    pub fn bin(&mut self, chunks: &[Chunk<T>], features: &[[T; C]], band: usize, tiles: usize) {
        // First one more at a span's first tile and one less behind its last, which takes no loop over its tiles.
        self.tile_starts.clear();
        self.tile_starts.resize(tiles + 2, 0);
        self.chunk_slots.clear();
        let mut slot = 0;
        for chunk in chunks {
            self.chunk_slots.push(slot);
            for span in chunk.spans(band) {
                let [first, last] = [span.first, span.last].map(usize::from);
                self.tile_starts[first + 1] = self.tile_starts[first + 1].wrapping_add(1);
                self.tile_starts[last + 2] = self.tile_starts[last + 2].wrapping_sub(1);
            }
            slot += chunk.spans(band).len() as u32;
        }
        self.chunk_slots.push(slot);
        self.tile_starts.truncate(tiles + 1);
        // A tile's start stands one place further until its entries, as they are listed, have made it the tile's end.
        let (mut start, mut splats) = (0, 0u32);
        for place in &mut self.tile_starts[1..] {
            splats = splats.wrapping_add(*place);
            *place = start;
            start += splats;
        }
        let empty = Entry { footprint: [T::zero(); 8], feature: [T::zero(); C], slot: 0 };
        self.entries.resize(start as usize, empty);
        let mut slot = 0;
        for chunk in chunks {
            for (span, splat) in chunk.spans(band).iter().zip(chunk.drawn(band)) {
                let feature = features[splat.rank as usize];
                for tile in span.first..=span.last {
                    let place = &mut self.tile_starts[usize::from(tile) + 1];
                    self.entries[*place as usize] = Entry { footprint: splat.footprint, feature, slot };
                    *place += 1;
                }
                slot += 1;
            }
        }
    }

    /// Once every [`WARMED`] tiles: brings their lists into the cache. A processor fetches ahead of what is read from end to
    /// end, but finds nothing to follow in a tile's few lines between all else that a tile takes.
    #[inline(always)]
    pub fn warm(&self, tile: usize) {
        if tile.is_multiple_of(WARMED) {
            let end = (tile + WARMED).min(self.tile_starts.len() - 1);
            for entry in &self.entries[self.tile_starts[tile] as usize..self.tile_starts[end] as usize] {
                black_box(entry.slot);
            }
        }
    }

    /// Splats of a tile, highest first.
    #[inline(always)]
    pub fn tile(&self, tile: usize) -> &[Entry<T, C>] {
        &self.entries[self.tile_starts[tile] as usize..self.tile_starts[tile + 1] as usize]
    }

    /// Number of splats that touch the band.
    pub fn slot_count(&self) -> usize {
        self.chunk_slots.last().map_or(0, |&n| n as usize)
    }

    /// The slots of one chunk's spans.
    pub fn slots_of_chunk(&self, chunk: usize) -> &[GradientSlot<T, C>] {
        &self.slots[self.chunk_slots[chunk] as usize..self.chunk_slots[chunk + 1] as usize]
    }
}
