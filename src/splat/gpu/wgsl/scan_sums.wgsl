// Sums before each block, from the sums of the blocks; the sum of all comes after the last.

/// Lengths; the one that counts is `FIELD`.
@group(0) @binding(0) var<storage, read> size: array<u32>;
@group(0) @binding(1) var<storage, read_write> block_sums: array<u32>;

override FIELD: u32;

var<workgroup> sums: array<u32, GROUP>;
var<workgroup> carry: u32;

@compute @workgroup_size(GROUP)
fn main(@builtin(local_invocation_index) lane: u32) {
    let blocks = (size[FIELD] + SCAN_BLOCK - 1u) / SCAN_BLOCK;
    var total = 0u;
    for (var start = 0u; start < blocks; start += GROUP) {
        let at = start + lane;
        var value = 0u;
        if at < blocks {
            value = block_sums[at];
        }
        let before = sums_before(lane, value);
        if at < blocks {
            block_sums[at] = total + before;
        }
        if lane == GROUP - 1u {
            carry = before + value;
        }
        total += workgroupUniformLoad(&carry);
    }
    if lane == 0u {
        block_sums[blocks] = total;
    }
}
