//! A stable radix sort on a device, and sums before each value.
//!
//! Every pass counts the values of a digit in each block of keys, sums up the counts, and writes keys and values to their places. No
//! workgroup waits for another, as Apple's, Arm's and Qualcomm's devices do not promise that it would end.

use super::constants::{DIGIT_BITS, DIGITS, GROUP, SCAN_BLOCK, SORT_BLOCK};
use super::device::GpuDevice;
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::shader;
use crate::splat::backend::GpuError;

/// Places in an array of sizes: number of values, and number of counts of a sort.
pub const VALUES: u32 = 0;
const COUNTS: u32 = 2;
/// Bytes of an array of sizes from which on the dispatches of a sort, of its scan, and of its values stand.
const SORT_GROUPS: u64 = 16;
const SCAN_GROUPS: u64 = 32;
/// See [`SORT_GROUPS`].
pub const VALUE_GROUPS: u64 = 48;
/// Words of an array of sizes.
pub const SIZES: u64 = 16;

/// Passes over keys below `keys`.
pub fn passes(keys: u64) -> u32 {
    (u64::BITS - keys.saturating_sub(1).leading_zeros()).div_ceil(DIGIT_BITS).max(1)
}

/// The compiled kernels of sums before each value.
pub struct ScanKernels {
    blocks: Kernel,
    sums: Kernel,
}

impl ScanKernels {
    /// Compiles them for the length at a place of an array of sizes.
    pub fn new(gpu: &GpuDevice, place: u32) -> Self {
        let constants = [("FIELD", f64::from(place))];
        Self {
            blocks: Kernel::new(gpu, shader::SCAN_BLOCKS, &constants),
            sums: Kernel::new(gpu, shader::SCAN_SUMS, &constants),
        }
    }
}

/// Sums before each value of an array: within blocks of [`SCAN_BLOCK`], and of the blocks.
pub struct Scan {
    blocks: Bound,
    sums: Bound,
    /// The sum before each block, and after the last the sum of all.
    pub block_sums: wgpu::Buffer,
}

impl Scan {
    /// Of an array with room for so many values.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &ScanKernels,
        sizes: &wgpu::Buffer,
        (values, capacity): (&wgpu::Buffer, u64),
    ) -> Result<Self, GpuError> {
        let block_sums = gpu.array("sums of blocks", capacity.div_ceil(SCAN_BLOCK.into()) + 1)?;
        Ok(Self {
            blocks: kernels.blocks.bind(gpu, &[sizes, values, &block_sums]),
            sums: kernels.sums.bind(gpu, &[sizes, &block_sums]),
            block_sums,
        })
    }

    /// The dispatches, given the workgroups of the first.
    pub fn on<'a>(&'a self, groups: Groups<'a>) -> [Dispatch<'a>; 2] {
        [self.blocks.on(groups), self.sums.on(Groups::Row(1))]
    }
}

/// The compiled kernels of a sort with passes for each digit of a 32-bit key.
pub struct SortKernels {
    count: Vec<Kernel>,
    scatter: Vec<Kernel>,
    scan: ScanKernels,
}

impl SortKernels {
    /// Compiles them.
    pub fn new(gpu: &GpuDevice) -> Self {
        let of_digits = |shader| {
            let digits = 0..u32::BITS / DIGIT_BITS;
            digits
                .map(|digit| Kernel::new(gpu, shader, &[("SHIFT", f64::from(digit * DIGIT_BITS))]))
                .collect()
        };
        Self {
            count: of_digits(shader::SORT_COUNT),
            scatter: of_digits(shader::SORT_SCATTER),
            scan: ScanKernels::new(gpu, COUNTS),
        }
    }
}

/// Keys and values to be sorted, and what the sort writes in between.
pub struct Sort {
    /// Keys before the sort.
    pub keys: wgpu::Buffer,
    /// Values before the sort.
    pub values: wgpu::Buffer,
    spare_keys: wgpu::Buffer,
    spare_values: wgpu::Buffer,
    count: Vec<[Bound; 2]>,
    scatter: Vec<[Bound; 2]>,
    scan: Scan,
}

impl Sort {
    /// With room for so many keys, whose number an array of sizes has.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &SortKernels,
        sizes: &wgpu::Buffer,
        capacity: u64,
    ) -> Result<Self, GpuError> {
        let array = |what| gpu.array(what, capacity);
        let (keys, values) = (array("keys")?, array("values")?);
        let (spare_keys, spare_values) = (array("spare keys")?, array("spare values")?);
        let counters = capacity.div_ceil(SORT_BLOCK.into()) * u64::from(DIGITS);
        let counts = gpu.array("counts of digits", counters)?;
        let scan = Scan::new(gpu, &kernels.scan, sizes, (&counts, counters))?;
        let sides =
            [(&keys, &values, &spare_keys, &spare_values), (&spare_keys, &spare_values, &keys, &values)];
        let count = kernels
            .count
            .iter()
            .map(|kernel| sides.map(|(from, ..)| kernel.bind(gpu, &[sizes, from, &counts])));
        let scatter = kernels.scatter.iter().map(|kernel| {
            sides.map(|(keys, values, to_keys, to_values)| {
                kernel.bind(gpu, &[sizes, keys, values, &counts, &scan.block_sums, to_keys, to_values])
            })
        });
        let (count, scatter) = (count.collect(), scatter.collect());
        Ok(Self { keys, values, spare_keys, spare_values, count, scatter, scan })
    }

    /// Keys and values after so many passes.
    pub fn sorted(&self, passes: u32) -> (&wgpu::Buffer, &wgpu::Buffer) {
        if passes.is_multiple_of(2) {
            (&self.keys, &self.values)
        } else {
            (&self.spare_keys, &self.spare_values)
        }
    }

    /// The passes over the lowest digits of so many keys.
    pub fn on(&self, passes: u32, keys: u64) -> impl Iterator<Item = Dispatch<'_>> {
        let blocks = keys.div_ceil(SORT_BLOCK.into());
        let scan = (blocks * u64::from(DIGITS)).div_ceil(SCAN_BLOCK.into());
        self.passes(passes, Groups::Row(blocks), Groups::Row(scan))
    }

    /// As [`Sort::on`], for as many keys as an array of sizes says.
    pub fn of<'a>(&'a self, passes: u32, sizes: &'a wgpu::Buffer) -> impl Iterator<Item = Dispatch<'a>> {
        self.passes(passes, Groups::Of(sizes, SORT_GROUPS), Groups::Of(sizes, SCAN_GROUPS))
    }

    fn passes<'a>(
        &'a self,
        passes: u32,
        blocks: Groups<'a>,
        scan: Groups<'a>,
    ) -> impl Iterator<Item = Dispatch<'a>> {
        (0..passes as usize).flat_map(move |digit| {
            let [count, scatter] =
                [&self.count, &self.scatter].map(|kernels| kernels[digit][digit % 2].on(blocks));
            let [of_blocks, before_blocks] = self.scan.on(scan);
            [count, of_blocks, before_blocks, scatter]
        })
    }
}

/// The array of sizes of a sort of so many keys.
pub fn sizes_of(keys: usize) -> [u32; 3] {
    let blocks = (keys as u32).div_ceil(SORT_BLOCK);
    [keys as u32, blocks, blocks * DIGITS]
}

/// Workgroups for so many lanes.
pub fn groups_for(lanes: u64) -> Groups<'static> {
    Groups::Row(lanes.div_ceil(GROUP.into()))
}
