//! The rasteriser on a device: projection, depth order, tile lists, compositing, and the gradient.
//!
//! Splats are sorted by depth; each then lists the tiles that it touches, and a stable sort of these pairs by tile leaves every tile's
//! list in depth order. A pair has a slot, to which the backward pass writes its gradient; the slots of a splat are successive, and
//! are summed up in their order. No sum is atomic: the same device gives the same bytes.

use super::camera_kind::CameraKind;
use super::constants::SCAN_BLOCK;
use super::device::GpuDevice;
use super::frames::ImageArrays;
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::plan_uniform::PlanUniform;
use super::shader;
use super::sort::{
    SIZES, Scan, ScanKernels, Sort, SortKernels, VALUE_GROUPS, VALUES, groups_for, passes, sizes_of,
};
use super::splats::{CORE, DeviceSplats};
use crate::splat::backend::GpuError;

/// Words of `Projected` in `wgsl/plan.wgsl`.
const PROJECTED: u64 = 16;
/// Passes of the sort by depth, whose keys are the bits of floating-point numbers.
const DEPTH_PASSES: u32 = 4;

/// The compiled kernels.
pub struct RasterKernels {
    kind: CameraKind,
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
    /// Compiles them for a kind of cameras.
    pub fn new(gpu: &GpuDevice, kind: CameraKind) -> Self {
        let kernel = |shader| Kernel::new(gpu, shader, &[]);
        let [project, forward, backward, gather] = match kind {
            CameraKind::Pinhole => [
                shader::PROJECT_PINHOLE,
                shader::FORWARD_COLOR,
                shader::BACKWARD_COLOR,
                shader::GATHER_PINHOLE,
            ],
            CameraKind::Parallel => [
                shader::PROJECT_PARALLEL,
                shader::FORWARD_COLOR_ALTITUDE,
                shader::BACKWARD_COLOR_ALTITUDE,
                shader::GATHER_PARALLEL,
            ],
        }
        .map(kernel);
        Self {
            kind,
            project,
            sort: SortKernels::new(gpu),
            scan: ScanKernels::new(gpu, VALUES),
            pair_counts: kernel(shader::PAIR_COUNTS),
            pair_sizes: kernel(shader::PAIR_SIZES),
            pair_emit: kernel(shader::PAIR_EMIT),
            tile_ranges: kernel(shader::TILE_RANGES),
            forward,
            backward,
            gather,
        }
    }
}

/// What all cameras of an iteration share: the order of the splats, and the sum of their gradients.
pub struct SortedOrder {
    /// The halted iteration, or 0, and the number of pairs that it needs.
    pub status: wgpu::Buffer,
    /// Sums of the splats' opacities over workgroups.
    pub opacity_sums: wgpu::Buffer,
    /// Derivatives by the splats' parameters: `Core` in `wgsl/plan.wgsl`.
    pub gradient: wgpu::Buffer,
    splat_sizes: wgpu::Buffer,
    depth_sort: Sort,
}

impl SortedOrder {
    /// Room for so many splats.
    pub fn new(gpu: &GpuDevice, kernels: &RasterKernels, capacity: usize) -> Result<Self, GpuError> {
        let n = capacity as u64;
        let splat_sizes = gpu.sizes("sizes of splats", SIZES)?;
        Ok(Self {
            status: gpu.array("status", 2)?,
            opacity_sums: gpu.array("sums of opacities", n)?,
            gradient: gpu.array("gradient", n * CORE as u64)?,
            depth_sort: Sort::new(gpu, &kernels.sort, &splat_sizes, n)?,
            splat_sizes,
        })
    }

    /// Tells the device how many splats there are.
    pub fn write_count(&self, gpu: &GpuDevice, splats: usize) {
        gpu.write(&self.splat_sizes, &sizes_of(splats));
    }

    /// Adds the sort of so many splats, which a camera has projected.
    pub fn sort<'a>(&'a self, list: &mut Vec<Dispatch<'a>>, splats: usize) {
        list.extend(self.depth_sort.on(DEPTH_PASSES, splats as u64));
    }
}

/// The arrays of a camera's render and its kernels with them.
pub struct Raster {
    /// The uniform of the render.
    pub plan: wgpu::Buffer,
    /// Room for so many pairs of splats and tiles.
    pub pair_capacity: u32,
    /// See [`ImageArrays::ranges`].
    pub ranges: wgpu::Buffer,
    pair_sizes: wgpu::Buffer,
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
    /// Room for so many pairs.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &RasterKernels,
        (order, image): (&SortedOrder, &ImageArrays),
        splats: &DeviceSplats,
        pair_capacity: u32,
    ) -> Result<Self, GpuError> {
        let SortedOrder { status, opacity_sums, gradient, splat_sizes, depth_sort } = order;
        let (core, rest, statistics) = (&splats.values.core, &splats.values.rest, &splats.statistics);
        let (n, pairs) = (splats.capacity as u64, u64::from(pair_capacity));
        let plan = gpu.uniform("plan", super::plan_uniform::WORDS as u64)?;
        let projected = gpu.array("images of splats", n * PROJECTED)?;
        let pair_sizes = gpu.sizes("sizes of pairs", SIZES)?;
        let pair_counts = gpu.array("tiles of splats", n)?;
        let pair_splats = gpu.array("splats of pairs", pairs)?;
        let slots = gpu.array("gradients of pairs of splats and tiles", pairs * kernels.kind.slot_words())?;
        let tile_sort = Sort::new(gpu, &kernels.sort, &pair_sizes, pairs)?;
        let scan = Scan::new(gpu, &kernels.scan, splat_sizes, (&pair_counts, n))?;
        let (_, sorted) = depth_sort.sorted(DEPTH_PASSES);
        let project = [&plan, core, rest, &projected, &depth_sort.keys, &depth_sort.values, opacity_sums];
        let emit = [
            &plan,
            sorted,
            &pair_counts,
            &scan.block_sums,
            &pair_sizes,
            &projected,
            &tile_sort.keys,
            &tile_sort.values,
            &pair_splats,
        ];
        let gather = [&plan, core, rest, &projected, &slots, status, gradient, statistics];
        let by_tile = [0, 1].map(|passes| {
            let (tiles, entries) = tile_sort.sorted(passes);
            let lists = [&plan, &image.ranges, entries, &pair_splats, &projected, &image.frame];
            let backward = [&lists[..], &[&image.by_pixel, &slots]].concat();
            ByTile {
                ranges: kernels.tile_ranges.bind(gpu, &[&plan, &pair_sizes, tiles, &image.ranges]),
                forward: kernels.forward.bind(gpu, &lists),
                backward: kernels.backward.bind(gpu, &backward),
            }
        });
        Ok(Self {
            project: kernels.project.bind(gpu, &project),
            count_pairs: kernels.pair_counts.bind(gpu, &[&plan, sorted, &projected, &pair_counts]),
            size_pairs: kernels.pair_sizes.bind(gpu, &[&plan, &scan.block_sums, status, &pair_sizes]),
            emit: kernels.pair_emit.bind(gpu, &emit),
            gather: kernels.gather.bind(gpu, &gather),
            by_tile,
            ranges: image.ranges.clone(),
            plan,
            pair_capacity,
            pair_sizes,
            tile_sort,
            scan,
        })
    }

    /// Number of pairs of splats and tiles of the last render.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read_pairs(&self, gpu: &GpuDevice) -> Result<u32, GpuError> {
        Ok(gpu.read(&self.pair_sizes, 1)?.first().copied().unwrap_or(0))
    }

    /// Adds the projection, which is before [`SortedOrder::sort`].
    pub fn project<'a>(&'a self, list: &mut Vec<Dispatch<'a>>, plan: &PlanUniform) {
        list.push(self.project.on(groups_for(plan.splats as u64)));
    }

    /// Adds the render of the sorted splats; the ranges of its tiles are zero before.
    pub fn forward<'a>(&'a self, list: &mut Vec<Dispatch<'a>>, plan: &PlanUniform) {
        let (n, [across, down]) = (plan.splats as u64, plan.tiles());
        let passes = Self::tile_passes(plan);
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
