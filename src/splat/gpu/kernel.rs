//! Compiled kernels, and kernels with the arrays that they work on.

use super::constants::MAX_GROUPS;
use super::device::GpuDevice;
use super::shader::Shader;

/// A compiled kernel.
#[derive(Debug)]
pub struct Kernel {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
}

/// A kernel with the arrays that it works on.
#[derive(Clone, Debug)]
pub struct Bound {
    name: &'static str,
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
}

/// The number of workgroups of a dispatch.
#[derive(Clone, Copy, Debug)]
pub enum Groups<'a> {
    /// So many in a row, which is folded where it is too long.
    Row(u64),
    /// So many columns, rows and planes.
    Box([u32; 3]),
    /// As an array says from this byte on.
    Of(&'a wgpu::Buffer, u64),
}

impl Kernel {
    /// Compiles a shader whose overridable constants have these values.
    pub fn new(gpu: &GpuDevice, shader: Shader, constants: &[(&str, f64)]) -> Self {
        let label = Some(shader.name);
        let source = wgpu::ShaderSource::Wgsl(shader.text().into());
        let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label, source });
        let compilation_options = wgpu::PipelineCompilationOptions {
            constants,
            // Every kernel writes its workgroup memory before it reads it.
            zero_initialize_workgroup_memory: false,
        };
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options,
            cache: None,
        });
        Self { name: shader.name, pipeline }
    }

    /// The kernel with the arrays of its bindings, in their order.
    pub fn bind(&self, gpu: &GpuDevice, arrays: &[&wgpu::Buffer]) -> Bound {
        let resources = (0..).zip(arrays).map(|(binding, array)| (binding, array.as_entire_binding()));
        let entries: Vec<_> =
            resources.map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Bound { name: self.name, pipeline: self.pipeline.clone(), group }
    }
}

/// A kernel that runs once, on so many workgroups.
#[derive(Clone, Copy, Debug)]
pub struct Dispatch<'a> {
    bound: &'a Bound,
    groups: Groups<'a>,
}

impl Bound {
    /// The kernel on so many workgroups.
    pub fn on<'a>(&'a self, groups: Groups<'a>) -> Dispatch<'a> {
        Dispatch { bound: self, groups }
    }
}

impl Dispatch<'_> {
    /// Name of the kernel.
    pub fn name(&self) -> &'static str {
        self.bound.name
    }

    /// Adds the dispatch to a pass.
    pub fn run(&self, pass: &mut wgpu::ComputePass) {
        pass.set_pipeline(&self.bound.pipeline);
        pass.set_bind_group(0, &self.bound.group, &[]);
        match self.groups {
            Groups::Row(count) => {
                let most = u64::from(MAX_GROUPS);
                pass.dispatch_workgroups(count.min(most) as u32, count.div_ceil(most) as u32, 1);
            }
            Groups::Box([columns, rows, planes]) => pass.dispatch_workgroups(columns, rows, planes),
            Groups::Of(array, byte) => pass.dispatch_workgroups_indirect(array, byte),
        }
    }
}
