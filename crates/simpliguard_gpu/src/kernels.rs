//! The kernels: their entry points in the shaders, and the buffers that each of them uses.

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, Buffer, ComputePass, ComputePipeline, ComputePipelineDescriptor,
    Device, PipelineCompilationOptions, ShaderModule, ShaderModuleDescriptor, ShaderSource,
};

const SOURCE: &str = concat!(
    include_str!("shaders/common.wgsl"),
    include_str!("shaders/silhouettes.wgsl"),
    include_str!("shaders/forward.wgsl"),
    include_str!("shaders/losses.wgsl"),
    include_str!("shaders/backward.wgsl"),
    include_str!("shaders/texture_least_squares.wgsl"),
);

/// Side of a tile of pixels, which one workgroup works on.
pub(crate) const TILE: usize = 16;
/// Most workgroups in a row of a dispatch.
const MOST_GROUPS: u32 = 65_535;

/// The buffers by their numbers in the shaders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub(crate) enum Slot {
    Params,
    Triangles,
    Vertices,
    Setups,
    Ids,
    Depth,
    Texels,
    Base,
    Reach,
    Edges,
    SourceView,
    Image,
    Residual,
    ImageGradient,
    BaseGradient,
    CornerGradients,
    EndGradients,
    Incidence,
    VertexGradients,
    Partials,
    PassOfFind,
    PixelSums,
    Covered,
    Rows,
    Solution,
    Remainder,
    Scaled,
    Heading,
    Product,
    Iteration,
    Coarse,
}

/// Number of [`Slot`]s.
const SLOTS: usize = Slot::Coarse as usize + 1;

/// Buffers in their slots.
#[derive(Clone, Copy)]
pub(crate) struct Bindings<'a>([Option<&'a Buffer>; SLOTS]);

impl<'a> Bindings<'a> {
    pub(crate) fn new(buffers: impl IntoIterator<Item = (Slot, &'a Buffer)>) -> Self {
        Self([None; SLOTS]).and(buffers)
    }

    /// With more buffers.
    pub(crate) fn and(mut self, buffers: impl IntoIterator<Item = (Slot, &'a Buffer)>) -> Self {
        buffers.into_iter().for_each(|(slot, buffer)| self.0[slot as usize] = Some(buffer));
        self
    }
}

/// A kernel, ready to run.
pub(crate) struct Kernel {
    pipeline: ComputePipeline,
    slots: &'static [Slot],
}

impl Kernel {
    fn new(device: &Device, module: &ShaderModule, entry_point: &str, slots: &'static [Slot]) -> Self {
        let pipeline = device.create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(entry_point),
            layout: None,
            module,
            entry_point: Some(entry_point),
            compilation_options: PipelineCompilationOptions::default(),
            cache: None,
        });
        Self { pipeline, slots }
    }

    fn bind(&self, device: &Device, Bindings(buffers): &Bindings<'_>) -> BindGroup {
        let entries: Vec<BindGroupEntry<'_>> = self
            .slots
            .iter()
            .filter_map(|&slot| {
                let resource = buffers[slot as usize]?.as_entire_binding();
                Some(BindGroupEntry { binding: slot as u32, resource })
            })
            .collect();
        let layout = self.pipeline.get_bind_group_layout(0);
        device.create_bind_group(&BindGroupDescriptor { label: None, layout: &layout, entries: &entries })
    }

    /// Runs so many workgroups, in rows.
    pub(crate) fn run(&self, pass: &mut ComputePass<'_>, device: &Device, buffers: &Bindings<'_>, groups: [u32; 2]) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bind(device, buffers), &[]);
        pass.dispatch_workgroups(groups[0], groups[1], 1);
    }
}

/// Workgroups for so many items, in as few rows as there can be.
pub(crate) fn groups(items: usize, per_group: usize) -> [u32; 2] {
    let groups = items.div_ceil(per_group) as u32;
    [groups.min(MOST_GROUPS), groups.div_ceil(MOST_GROUPS)]
}

macro_rules! kernels {
    ($($(#[$doc:meta])* $name:ident: $($slot:ident)*;)*) => {
        /// All kernels of a device. Each is named as its entry point.
        pub(crate) struct Kernels {
            $($(#[$doc])* pub(crate) $name: Kernel,)*
        }

        impl Kernels {
            pub(crate) fn new(device: &Device) -> Self {
                let source = ShaderSource::Wgsl(SOURCE.into());
                let module = device.create_shader_module(ShaderModuleDescriptor { label: Some("refine"), source });
                Self { $($name: Kernel::new(device, &module, stringify!($name), &[$(Slot::$slot),*]),)* }
            }
        }

        #[cfg(test)]
        const NAMES: &[(&str, &[Slot])] = &[$((stringify!($name), &[$(Slot::$slot),*])),*];
    };
}

kernels! {
    set_up: Params Triangles Vertices Setups;
    rasterise: Params Setups Ids Depth;
    shade: Params Triangles Setups Ids Texels Base;
    clear_blends: Params Reach Edges;
    find_blends: Params Triangles Vertices Setups Ids Depth Reach Edges PassOfFind;
    blend: Params Base Reach Edges Image;
    find_residual: Params Image SourceView Residual;
    image_loss: Params Residual ImageGradient Partials;
    squared_errors: Params Image SourceView Partials;
    squared_errors_of_means: Params Base SourceView Partials;
    backward_blends: Params ImageGradient Reach Edges BaseGradient;
    backward_shading: Params Triangles Vertices Setups Ids Texels BaseGradient CornerGradients;
    backward_edges: Params Triangles Vertices Setups Reach Edges Base ImageGradient EndGradients;
    gather_vertices: Params Incidence CornerGradients EndGradients VertexGradients;
    clear_sums: Params PixelSums;
    assemble: Params Triangles Setups Ids Reach Edges SourceView PixelSums Coarse;
    regularise: Params Texels PixelSums Covered Rows Solution Heading Coarse;
    begin_descent: Params Rows Heading Remainder Scaled Partials;
    multiply: Params Rows Heading Product Partials;
    step_solution: Params Rows Solution Remainder Scaled Heading Product Partials Iteration;
    turn: Params Scaled Heading Iteration;
    first_energy: Params Partials Iteration;
    step_length: Params Partials Iteration;
    next_factor: Params Partials Iteration;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_stay_within_the_limits_of_web_gpu() {
        let uniforms = [Slot::Params, Slot::PassOfFind];
        for (name, slots) in NAMES {
            assert!(slots.iter().filter(|slot| !uniforms.contains(slot)).count() <= 8, "{name}");
        }
    }

    #[test]
    fn many_workgroups_make_rows() {
        assert_eq!(groups(0, 64), [0, 0]);
        assert_eq!(groups(65, 64), [2, 1]);
        assert_eq!(groups(64 * 65_536, 64), [65_535, 2]);
    }
}
