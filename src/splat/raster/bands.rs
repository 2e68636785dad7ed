//! A band of sixteen pixel rows: the list of splats of each of its tiles in depth order, and a gradient slot for each splat
//! that touches the band.

use super::gradient_slot::GradientSlot;
use super::primitive::Primitive;
use super::project::Chunk;
use crate::simd::Real;
use std::hint::black_box;

/// A splat in a tile's list, with everything that rendering needs, so that memory is read in order.
#[derive(Clone, Copy, Debug)]
pub(super) struct TileEntry<T: Real, const C: usize, P: Primitive> {
    /// The fields of its [`super::footprint::Footprint`].
    pub footprint: [T; 8],
    /// Slope of its plane.
    pub slope: P::Slope<T>,
    /// Rendered features: colour, altitude or others.
    pub feature: [T; C],
    /// Index of the splat's gradient slot in the band.
    pub slot: u32,
}

/// Number of tiles whose lists are prefetched together; few enough for the cache of one core.
const PREFETCH_TILES: usize = 8;

/// Tile lists and gradient slots of one band.
pub(super) struct Band<T: Real, const C: usize, P: Primitive> {
    /// The entries of tile `t` are `entries[tile_starts[t]..tile_starts[t + 1]]`.
    tile_starts: Vec<u32>,
    entries: Vec<TileEntry<T, C, P>>,
    /// Index of the first slot of each chunk, which has one slot for each of its spans in this band.
    chunk_slots: Vec<u32>,
    /// Gradient sums of the splats, as the backward pass leaves them.
    pub slots: Vec<GradientSlot<T, C, P>>,
    /// Buffer of the backward pass with one value for each pixel.
    pub products: Vec<T>,
    /// Number of splat-pixel pairs that the last forward pass computed.
    pub computed_pairs: usize,
}

impl<T: Real, const C: usize, P: Primitive> Default for Band<T, C, P> {
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

impl<T: Real, const C: usize, P: Primitive> Band<T, C, P> {
    /// Lists the splats of every tile with a counting sort. Chunks come in the order of ranks, so each list is in depth order.
    pub fn bin(&mut self, chunks: &[Chunk<T, P>], features: &[[T; C]], band: usize, tiles: usize) {
        // A difference array: +1 at a span's first tile and -1 after its last. Its prefix sums are the numbers of splats in
        // the tiles, without a loop over each span's tiles. Tile `t` stands at `t + 1`.
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
        // Prefix sum of the difference array, and the running total of its sums. `tile_starts[t + 1]` becomes the start of
        // tile `t`; listing the tile's entries below advances it to the tile's end, which is the start of tile `t + 1`.
        let (mut start, mut splats) = (0, 0u32);
        for value in &mut self.tile_starts[1..] {
            splats = splats.wrapping_add(*value);
            *value = start;
            start += splats;
        }
        let empty = TileEntry {
            footprint: [T::zero(); 8],
            slope: P::Slope::default(),
            feature: [T::zero(); C],
            slot: 0,
        };
        self.entries.resize(start as usize, empty);
        let mut slot = 0;
        for chunk in chunks {
            for (span, splat) in chunk.spans(band).iter().zip(chunk.splats(band)) {
                let feature = features[splat.rank as usize];
                for tile in span.first..=span.last {
                    let next = &mut self.tile_starts[usize::from(tile) + 1];
                    let (footprint, slope) = (splat.footprint, splat.slope);
                    self.entries[*next as usize] = TileEntry { footprint, slope, feature, slot };
                    *next += 1;
                }
                slot += 1;
            }
        }
    }

    /// Reads the lists of the next [`PREFETCH_TILES`] tiles into the cache, once for that many tiles. The processor's own
    /// prefetcher does not do this: a tile's list is short, and other memory is read between two lists.
    #[inline(always)]
    pub fn prefetch(&self, tile: usize) {
        if tile.is_multiple_of(PREFETCH_TILES) {
            let end = (tile + PREFETCH_TILES).min(self.tile_starts.len() - 1);
            for entry in &self.entries[self.tile_starts[tile] as usize..self.tile_starts[end] as usize] {
                black_box(entry.slot);
            }
        }
    }

    /// The list of a tile, nearest splat first.
    #[inline(always)]
    pub fn tile(&self, tile: usize) -> &[TileEntry<T, C, P>] {
        &self.entries[self.tile_starts[tile] as usize..self.tile_starts[tile + 1] as usize]
    }

    /// Number of splats that touch the band.
    pub fn slot_count(&self) -> usize {
        self.chunk_slots.last().map_or(0, |&n| n as usize)
    }

    /// The slots of one chunk's spans, in their order.
    pub fn slots_of_chunk(&self, chunk: usize) -> &[GradientSlot<T, C, P>] {
        &self.slots[self.chunk_slots[chunk] as usize..self.chunk_slots[chunk + 1] as usize]
    }
}
