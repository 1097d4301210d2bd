//! The limits of the import.

/// The most that a file may ask of the machine. Each limit is checked before the memory is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImportLimits {
    /// The file and all files that it refers to, in bytes.
    pub bytes: u64,
    /// Number of values in the JSON.
    pub json_values: u64,
    /// Memory that the parsed JSON takes, in bytes, estimated from the text. Nested lists and objects take a hundred times as
    /// much as their text.
    pub json_bytes: u64,
    /// Number of glTF nodes.
    pub nodes: u64,
    /// Depth of the node tree.
    pub depth: u64,
    /// Number of triangles of the default scene, over all instances.
    pub triangles: u64,
    /// Number of texels of all images in use.
    pub texels: u64,
    /// Memory in bytes, estimated: that of the import, and after it that of the bake.
    pub memory: u64,
}

impl Default for ImportLimits {
    fn default() -> Self {
        Self {
            bytes: 2 << 30,
            json_values: 20_000_000,
            json_bytes: 2 << 30,
            nodes: 200_000,
            depth: 512,
            triangles: 20_000_000,
            texels: 512 << 20,
            memory: 8 << 30,
        }
    }
}
