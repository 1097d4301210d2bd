//! The lines in the panel about memory on the GPU: all models, and the largest ones.

use bevy::prelude::*;

use crate::lod::{LodGroup, Memory, ModelMemory, memory_of};

/// Largest number of models with a line of their own.
const ROWS: usize = 6;

/// The lines.
#[derive(Component)]
pub(super) struct MemoryLines;

/// Updates the lines.
pub(super) fn memory(
    mut lines: Single<'_, '_, &mut Text, With<MemoryLines>>,
    groups: Query<'_, '_, &LodGroup>,
    meshes: Option<Res<'_, Assets<Mesh>>>,
    images: Option<Res<'_, Assets<Image>>>,
) {
    let (Some(meshes), Some(images)) = (meshes, images) else { return };
    lines.set_if_neq(Text(lines_of(&memory_of(groups, &meshes, &images))));
}

fn lines_of(models: &[ModelMemory]) -> String {
    if models.is_empty() {
        return String::new();
    }
    let (mut source, mut levels) = (Memory::default(), Memory::default());
    for model in models {
        source += model.source;
        levels += model.levels;
    }
    let mut out = format!("memory: {}", pair(source, levels));
    for ModelMemory { path, source, levels } in models.iter().take(ROWS).filter(|_| models.len() > 1) {
        out += &format!("\n{path}: {}", pair(*source, *levels));
    }
    match models.len().saturating_sub(ROWS) {
        0 => out,
        more => out + &format!("\nand {more} more"),
    }
}

fn pair(source: Memory, levels: Memory) -> String {
    let of = |memory: Memory| format!("{} textures, {} meshes", megabytes(memory.textures), megabytes(memory.meshes));
    format!("source {}; levels {}", of(source), of(levels))
}

fn megabytes(bytes: u64) -> String {
    format!("{:.1} MB", bytes as f64 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_models_are_summed_and_the_largest_have_lines() {
        let model = |path: &str| ModelMemory {
            path: path.into(),
            source: Memory { textures: 12_000_000, meshes: 250_000 },
            levels: Memory { textures: 1_000_000, meshes: 0 },
        };
        let one = "memory: source 12.0 MB textures, 0.2 MB meshes; levels 1.0 MB textures, 0.0 MB meshes";
        assert_eq!(lines_of(&[model("a.glb")]), one);
        let many: Vec<ModelMemory> = (0..8).map(|i| model(&format!("{i}.glb"))).collect();
        let text = lines_of(&many);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].starts_with("memory: source 96.0 MB textures, 2.0 MB meshes; levels 8.0 MB"), "{text}");
        assert!(lines.len() == 2 + ROWS && lines[1].starts_with("0.glb: source 12.0 MB"), "{text}");
        assert_eq!((lines[7], lines_of(&[])), ("and 2 more", String::new()));
    }
}
