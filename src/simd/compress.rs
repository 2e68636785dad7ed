//! Indices of the bits and lanes that are set.

/// Indices of the set bits of an integer, in ascending order.
#[inline(always)]
pub fn set_bits(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (bits != 0).then(|| {
            // The remainder changes nothing: it lets the compiler leave out bounds checks.
            let index = bits.trailing_zeros() as usize % u32::BITS as usize;
            bits &= bits - 1;
            index
        })
    })
}

/// The byte 1 repeated eight times.
const ONES: u64 = 0x0101_0101_0101_0101;

/// For each value of a byte, the indices of its set bits: one byte each, in ascending order from the lowest byte.
const INDICES: [u64; 256] = {
    let mut table = [0; 256];
    let mut set = 0;
    while set < 256 {
        let (mut index, mut count) = (0, 0);
        while index < 8 {
            if set >> index & 1 == 1 {
                table[set] |= index << (8 * count);
                count += 1;
            }
            index += 1;
        }
        set += 1;
    }
    table
};

/// [`Simd::compress`](super::Simd::compress) of eight lanes, by a table of the indices of set bits.
#[inline(always)]
pub(super) fn compress_eight(bits: u8, first: u8, indices: &mut [u8]) -> usize {
    let vector = INDICES[usize::from(bits)] + u64::from(first) * ONES;
    indices[..8].copy_from_slice(&vector.to_le_bytes());
    bits.count_ones() as usize
}
