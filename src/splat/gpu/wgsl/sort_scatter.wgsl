// Last step of a pass of the radix sort: writes keys and values in the order of a digit; equal ones keep their order.
//
// The place of a key among the equal digits of 256 successive keys is the number of bits before it in a row of 256 bits, so that it does
// not depend on the order in which lanes set them.

/// Number of keys, of blocks, and of counts.
@group(0) @binding(0) var<storage, read> size: array<u32>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
/// Counts before each digit and block within their blocks of the scan, and before those blocks.
@group(0) @binding(3) var<storage, read> counts: array<u32>;
@group(0) @binding(4) var<storage, read> block_sums: array<u32>;
@group(0) @binding(5) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_values: array<u32>;

override SHIFT: u32;

const WORDS: u32 = GROUP / 32u;

var<workgroup> has_digit: array<atomic<u32>, DIGITS * WORDS>;
var<workgroup> next: array<u32, DIGITS>;

@compute @workgroup_size(GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let block = group_index(group, groups);
    if block >= size[1] {
        return;
    }
    let count = lane * size[1] + block;
    next[lane] = counts[count] + block_sums[count / SCAN_BLOCK];
    for (var round = 0u; round < SORT_ROUNDS; round++) {
        for (var word = 0u; word < WORDS; word++) {
            atomicStore(&has_digit[lane * WORDS + word], 0u);
        }
        workgroupBarrier();
        let at = (block * SORT_ROUNDS + round) * GROUP + lane;
        var key = 0u;
        var digit = 0u;
        let bit = 1u << (lane % 32u);
        if at < size[0] {
            key = keys[at];
            digit = (key >> SHIFT) % DIGITS;
            atomicOr(&has_digit[digit * WORDS + lane / 32u], bit);
        }
        workgroupBarrier();
        if at < size[0] {
            var place = next[digit];
            for (var word = 0u; word < lane / 32u; word++) {
                place += countOneBits(atomicLoad(&has_digit[digit * WORDS + word]));
            }
            place += countOneBits(atomicLoad(&has_digit[digit * WORDS + lane / 32u]) & (bit - 1u));
            sorted_keys[place] = key;
            sorted_values[place] = values[at];
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            next[lane] += countOneBits(atomicLoad(&has_digit[lane * WORDS + word]));
        }
    }
}
