// The sum over the lanes of a workgroup, in a fixed order; it counts in the first lane. A kernel declares the type `Summed` and
// `sums`, one for each lane.

fn sum_of_lanes(lane: u32, value: Summed) -> Summed {
    workgroupBarrier();
    sums[lane] = value;
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if lane < half {
            sums[lane] += sums[lane + half];
        }
    }
    return sums[lane];
}
