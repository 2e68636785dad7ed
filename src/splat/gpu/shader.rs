//! The shaders: one WGSL file for each kernel, after the parts that it shares with others.

use super::constants;

/// A kernel and the parts that it consists of.
#[derive(Clone, Copy, Debug)]
pub struct Shader {
    /// Its name.
    pub name: &'static str,
    parts: &'static [&'static str],
}

impl Shader {
    /// Its text, with the constants.
    pub fn text(&self) -> String {
        constants::wgsl() + &self.parts.join("\n")
    }
}

/// Declares the shaders: for each its constant, the name of its file, and the parts that stand before it.
macro_rules! shaders {
    ($($shader:ident = $file:literal after [$($part:literal),*];)*) => {
        $(
            #[doc = concat!("The kernel `", $file, ".wgsl`.")]
            pub const $shader: Shader = Shader {
                name: $file,
                parts: &[
                    include_str!("wgsl/plan.wgsl"),
                    $(include_str!(concat!("wgsl/", $part, ".wgsl")),)*
                    include_str!(concat!("wgsl/", $file, ".wgsl")),
                ],
            };
        )*
        /// All of them.
        #[cfg(test)]
        pub const ALL: &[Shader] = &[$($shader),*];
    };
}

shaders! {
    PROJECT_PINHOLE = "project" after ["shape", "pinhole", "color", "harmonics", "spans", "sum"];
    PROJECT_PARALLEL = "project" after ["shape", "parallel", "color_altitude", "harmonics", "spans", "sum"];
    SORT_COUNT = "sort_count" after [];
    SORT_SCATTER = "sort_scatter" after [];
    SCAN_BLOCKS = "scan_blocks" after ["scan"];
    SCAN_SUMS = "scan_sums" after ["scan"];
    PAIR_COUNTS = "pair_counts" after [];
    PAIR_SIZES = "pair_sizes" after [];
    PAIR_EMIT = "pair_emit" after ["spans"];
    TILE_RANGES = "tile_ranges" after [];
    FORWARD_COLOR = "forward" after ["color", "alpha"];
    FORWARD_COLOR_ALTITUDE = "forward" after ["color_altitude", "alpha"];
    BACKWARD_COLOR = "backward" after ["color", "alpha"];
    BACKWARD_COLOR_ALTITUDE = "backward" after ["color_altitude", "alpha"];
    GATHER_PINHOLE = "gather" after ["shape", "pinhole", "color", "harmonics"];
    GATHER_PARALLEL = "gather" after ["shape", "parallel", "color_altitude", "harmonics"];
    SSIM_FORWARD_PHOTOGRAPH = "ssim_forward" after ["photograph", "window", "sum"];
    SSIM_FORWARD_LINEAR = "ssim_forward" after ["linear_target", "window", "sum"];
    SSIM_BACKWARD_PHOTOGRAPH = "ssim_backward" after ["photograph", "window", "sum"];
    SSIM_BACKWARD_LINEAR = "ssim_backward" after ["linear_target", "window", "sum"];
    TARGET = "target" after ["shading"];
    SHADE = "shade" after ["shading", "color_model", "view_model", "sum"];
    SHADE_BACKWARD = "shade_backward" after ["shading", "color_model", "view_model", "sum"];
    SUN_BACKWARD = "sun_backward" after [];
    COMPARE = "compare" after ["shading", "sum"];
    COMPARE_SUMS = "compare_sums" after ["sum"];
    COMPARE_BACKWARD = "compare_backward" after ["shading"];
    SURFACE_PRIOR = "surface_prior" after ["shading", "sum"];
    ANCHOR_BEGIN = "anchor_begin" after ["shading", "anchoring"];
    ANCHOR_END = "anchor_end" after ["shading", "anchoring"];
    STEP_REST = "step_rest" after ["pinhole", "harmonics", "adam"];
    STEP_CORE = "step_core" after ["adam"];
    STEP_APPEARANCE = "step_appearance" after ["shading", "color_model", "adam", "sum"];
    REPORT = "report" after ["sum"];
    REPORT_TERMS = "report_terms" after ["shading", "sum"];
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::naga::{front::wgsl, valid};

    /// Storage buffers and bytes of workgroup memory that every device of WebGPU has.
    const STORAGE_BUFFERS: usize = 8;
    const WORKGROUP_BYTES: u32 = 16_384;

    #[test]
    fn every_shader_is_valid_and_within_the_limits_of_every_device() {
        for shader in ALL {
            let text = shader.text();
            let module = wgsl::parse_str(&text)
                .unwrap_or_else(|e| panic!("{}: {}", shader.name, e.emit_to_string(&text)));
            let mut validator =
                valid::Validator::new(valid::ValidationFlags::all(), valid::Capabilities::empty());
            if let Err(e) = validator.validate(&module) {
                panic!("{}: {}", shader.name, e.emit_to_string(&text));
            }
            let mut layouter = wgpu::naga::proc::Layouter::default();
            layouter.update(module.to_ctx()).expect("a valid module has a layout");
            let globals = || module.global_variables.iter().map(|(_, v)| v);
            let storage = globals().filter(|v| matches!(v.space, wgpu::naga::AddressSpace::Storage { .. }));
            assert!(storage.count() <= STORAGE_BUFFERS, "{}", shader.name);
            let workgroup = globals().filter(|v| v.space == wgpu::naga::AddressSpace::WorkGroup);
            let bytes: u32 = workgroup.map(|v| layouter[v.ty].size).sum();
            assert!(bytes <= WORKGROUP_BYTES, "{}: {bytes}", shader.name);
        }
    }
}
