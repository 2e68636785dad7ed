// The sum of the values of all lanes before this one (Hillis and Steele).

fn sums_before(lane: u32, value: u32) -> u32 {
    workgroupBarrier();
    sums[lane] = value;
    for (var reach = 1u; reach < GROUP; reach *= 2u) {
        workgroupBarrier();
        var more = 0u;
        if lane >= reach {
            more = sums[lane - reach];
        }
        workgroupBarrier();
        sums[lane] += more;
    }
    workgroupBarrier();
    return sums[lane] - value;
}
