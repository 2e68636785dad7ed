//! The rasteriser on a device: projection, depth order, tile lists, compositing, and the gradient.
//!
//! Splats are sorted by depth; each then lists the tiles that it touches, and a stable sort of these pairs by tile leaves every tile's
//! list in depth order. A pair has a slot, to which the backward pass writes its gradient; the slots of a splat are successive, and
//! are summed up in their order. No sum is atomic: the same device gives the same bytes.

use super::constants::{SCAN_BLOCK, SLOT};
use super::device::GpuDevice;
use super::frames::Frames;
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::plan_uniform::PlanUniform;
use super::shader;
use super::sort::{
    SIZES, Scan, ScanKernels, Sort, SortKernels, VALUE_GROUPS, VALUES, groups_for, passes, sizes_of,
};
use super::splats::{CORE, SplatParameters};
use crate::splat::backend::GpuError;

/// Words of `Projected` in `wgsl/plan.wgsl`.
const PROJECTED: u64 = 16;
/// Passes of the sort by depth, whose keys are the bits of floating-point numbers.
const DEPTH_PASSES: u32 = 4;

/// The compiled kernels.
pub struct RasterKernels {
    project: Kernel,
    sort: SortKernels,
    scan: ScanKernels,
    pair_counts: Kernel,
    pair_sizes: Kernel,
    pair_emit: Kernel,
    tile_ranges: Kernel,
    forward: Kernel,
    backward: Kernel,
    gather: Kernel,
}

impl RasterKernels {
    /// Compiles them.
    pub fn new(gpu: &GpuDevice) -> Self {
        let kernel = |shader| Kernel::new(gpu, shader, &[]);
        Self {
            project: kernel(shader::PROJECT),
            sort: SortKernels::new(gpu),
            scan: ScanKernels::new(gpu, VALUES),
            pair_counts: kernel(shader::PAIR_COUNTS),
            pair_sizes: kernel(shader::PAIR_SIZES),
            pair_emit: kernel(shader::PAIR_EMIT),
            tile_ranges: kernel(shader::TILE_RANGES),
            forward: kernel(shader::FORWARD),
            backward: kernel(shader::BACKWARD),
            gather: kernel(shader::GATHER),
        }
    }
}

/// The arrays of the rasteriser and its kernels with them.
pub struct Raster {
    /// The uniform of an iteration.
    pub plan: wgpu::Buffer,
    /// The halted iteration, or 0, and the number of pairs that it needs.
    pub status: wgpu::Buffer,
    /// Sums of the splats' opacities over workgroups.
    pub opacity_sums: wgpu::Buffer,
    /// Derivatives by the splats' parameters: `Core` in `wgsl/plan.wgsl`.
    pub gradient: wgpu::Buffer,
    /// Room for so many pairs of splats and tiles.
    pub pair_capacity: u32,
    splat_sizes: wgpu::Buffer,
    pair_sizes: wgpu::Buffer,
    depth_sort: Sort,
    tile_sort: Sort,
    scan: Scan,
    project: Bound,
    count_pairs: Bound,
    size_pairs: Bound,
    emit: Bound,
    gather: Bound,
    /// After an even and an odd number of passes of the sort by tile.
    by_tile: [ByTile; 2],
}

/// The kernels that read the lists of tiles.
struct ByTile {
    ranges: Bound,
    forward: Bound,
    backward: Bound,
}

impl Raster {
    /// Room for so many splats and pairs.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &RasterKernels,
        frames: &Frames,
        (splats, statistics): (&SplatParameters, &wgpu::Buffer),
        (capacity, pair_capacity): (usize, u32),
    ) -> Result<Self, GpuError> {
        let (n, pairs) = (capacity as u64, u64::from(pair_capacity));
        let plan = gpu.uniform("plan", super::plan_uniform::WORDS as u64)?;
        let status = gpu.array("status", 2)?;
        let projected = gpu.array("images of splats", n * PROJECTED)?;
        let opacity_sums = gpu.array("sums of opacities", n)?;
        let gradient = gpu.array("gradient", n * CORE as u64)?;
        let splat_sizes = gpu.sizes("sizes of splats", SIZES)?;
        let pair_sizes = gpu.sizes("sizes of pairs", SIZES)?;
        let pair_counts = gpu.array("tiles of splats", n)?;
        let pair_splats = gpu.array("splats of pairs", pairs)?;
        let slots = gpu.array("gradients of pairs of splats and tiles", pairs * u64::from(SLOT))?;
        let depth_sort = Sort::new(gpu, &kernels.sort, &splat_sizes, n)?;
        let tile_sort = Sort::new(gpu, &kernels.sort, &pair_sizes, pairs)?;
        let scan = Scan::new(gpu, &kernels.scan, &splat_sizes, (&pair_counts, n))?;
        let (_, order) = depth_sort.sorted(DEPTH_PASSES);
        let project = [
            &plan,
            &splats.core,
            &splats.rest,
            &projected,
            &depth_sort.keys,
            &depth_sort.values,
            &opacity_sums,
        ];
        let emit = [
            &plan,
            order,
            &pair_counts,
            &scan.block_sums,
            &pair_sizes,
            &projected,
            &tile_sort.keys,
            &tile_sort.values,
            &pair_splats,
        ];
        let gather = [&plan, &splats.core, &splats.rest, &projected, &slots, &status, &gradient, statistics];
        let by_tile = [0, 1].map(|passes| {
            let (tiles, sorted) = tile_sort.sorted(passes);
            let lists = [&plan, &frames.ranges, sorted, &pair_splats, &projected, &frames.frame];
            let backward = [&lists[..], &[&frames.by_pixel, &slots]].concat();
            ByTile {
                ranges: kernels.tile_ranges.bind(gpu, &[&plan, &pair_sizes, tiles, &frames.ranges]),
                forward: kernels.forward.bind(gpu, &lists),
                backward: kernels.backward.bind(gpu, &backward),
            }
        });
        Ok(Self {
            project: kernels.project.bind(gpu, &project),
            count_pairs: kernels.pair_counts.bind(gpu, &[&plan, order, &projected, &pair_counts]),
            size_pairs: kernels.pair_sizes.bind(gpu, &[&plan, &scan.block_sums, &status, &pair_sizes]),
            emit: kernels.pair_emit.bind(gpu, &emit),
            gather: kernels.gather.bind(gpu, &gather),
            by_tile,
            plan,
            status,
            opacity_sums,
            gradient,
            pair_capacity,
            splat_sizes,
            pair_sizes,
            depth_sort,
            tile_sort,
            scan,
        })
    }

    /// Tells the device how many splats there are.
    pub fn write_count(&self, gpu: &GpuDevice, splats: usize) {
        gpu.write(&self.splat_sizes, &sizes_of(splats));
    }

    /// Number of pairs of splats and tiles of the last iteration.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read_pairs(&self, gpu: &GpuDevice) -> Result<u32, GpuError> {
        Ok(gpu.read(&self.pair_sizes, 1)?.first().copied().unwrap_or(0))
    }

    /// Adds the render of a view; the ranges of its tiles are zero before.
    pub fn forward<'a>(&'a self, list: &mut Vec<Dispatch<'a>>, plan: &PlanUniform) {
        let (n, [across, down]) = (plan.splats as u64, plan.tiles());
        let passes = Self::tile_passes(plan);
        list.push(self.project.on(groups_for(n)));
        list.extend(self.depth_sort.on(DEPTH_PASSES, n));
        list.push(self.count_pairs.on(groups_for(n)));
        list.extend(self.scan.on(Groups::Row(n.div_ceil(SCAN_BLOCK.into()))));
        list.push(self.size_pairs.on(Groups::Row(1)));
        list.push(self.emit.on(groups_for(n)));
        list.extend(self.tile_sort.of(passes, &self.pair_sizes));
        let by_tile = &self.by_tile[passes as usize % 2];
        list.push(by_tile.ranges.on(Groups::Of(&self.pair_sizes, VALUE_GROUPS)));
        list.push(by_tile.forward.on(Groups::Box([across, down, 1])));
    }

    /// Adds the gradient by the splats' parameters, from the derivatives by pixels.
    pub fn backward<'a>(&'a self, list: &mut Vec<Dispatch<'a>>, plan: &PlanUniform) {
        let [across, down] = plan.tiles();
        let by_tile = &self.by_tile[Self::tile_passes(plan) as usize % 2];
        list.push(by_tile.backward.on(Groups::Box([across, down, 1])));
        list.push(self.gather.on(groups_for(plan.splats as u64)));
    }

    /// Passes of the sort by tile; the number of tiles stands for none.
    fn tile_passes(plan: &PlanUniform) -> u32 {
        let [across, down] = plan.tiles();
        passes(u64::from(across) * u64::from(down) + 1)
    }
}
