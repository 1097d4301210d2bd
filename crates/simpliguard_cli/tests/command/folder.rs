//! A folder to run the command in, and models to put there.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use serde_json::{Value, json};

/// A temporary folder with a cache of its own.
pub(crate) struct Folder(tempfile::TempDir);

/// The outcome of a run.
pub(crate) struct Run {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// Adds a file.
    pub(crate) fn with(self, path: &str, content: impl AsRef<[u8]>) -> Self {
        let path = self.path(path);
        fs::create_dir_all(path.parent().expect("below the folder")).expect("makes folders");
        fs::write(path, content).expect("writes");
        self
    }

    pub(crate) fn path(&self, path: &str) -> PathBuf {
        self.0.path().join(path)
    }

    /// The command, ready to be started in the folder.
    pub(crate) fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_simpliguard"));
        command.args(args).current_dir(self.0.path()).env("SIMPLIGUARD_CACHE_DIR", self.path("cache"));
        command
    }

    pub(crate) fn run(&self, args: &[&str]) -> Run {
        let output = self.command(args).output().expect("starts");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        Run { code: output.status.code().unwrap_or(-1), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    pub(crate) fn bake(&self, args: &[&str]) -> Run {
        self.run(&[&["bake"], args].concat())
    }
}

impl Run {
    /// Asserts that stderr holds a text.
    pub(crate) fn says(&self, text: &str) {
        assert!(self.stderr.contains(text), "'{text}' is not in\n{}", self.stderr);
    }

    /// The JSON document.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).expect("stdout is one JSON document")
    }
}

/// One triangle, as binary glTF.
pub(crate) fn triangle() -> Vec<u8> {
    glb(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]])
}

/// The bytes of [`triangle_beside`].
pub(crate) const TRIANGLE: [u8; 36] = {
    let mut bytes = [0; 36];
    // 1.0 as the x of the second vertex and as the y of the third.
    (bytes[14], bytes[15], bytes[30], bytes[31]) = (0x80, 0x3f, 0x80, 0x3f);
    bytes
};

/// One triangle, as glTF whose bytes lie in another file.
pub(crate) fn triangle_beside(uri: &str) -> String {
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 36, "uri": uri}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3,
                       "min": [0, 0, 0], "max": [1, 1, 0]}],
    })
    .to_string()
}

/// A bumpy sphere of `2 * rings * rings` triangles.
pub(crate) fn sphere(rings: u32) -> Vec<u8> {
    let (positions, triangles) = bumpy_sphere(rings);
    glb(&positions, &triangles)
}

/// A scene: two spheres, one of them moved, turned and scaled, and a node of 52 triangles, too few for levels.
pub(crate) fn scene() -> Vec<u8> {
    let (positions, triangles) = bumpy_sphere(12);
    let nodes = json!([
        {"name": "Ball", "mesh": 0, "translation": [0, 0, 2]},
        {"name": "Ball.001", "mesh": 0, "translation": [5, 0, 0], "rotation": [0.6, 0, 0, 0.8], "scale": [2, 2, 2]},
        {"name": "Scrap", "mesh": 1, "translation": [0, 4, 0]},
    ]);
    // The other mesh takes each three positions for a triangle.
    let meshes = json!([mesh(), {"primitives": [{"attributes": {"POSITION": 0}}]}]);
    glb_of(&positions, &triangles, (&nodes, &meshes))
}

fn bumpy_sphere(rings: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let step = std::f32::consts::PI / rings as f32;
    let position = |i: u32, j: u32| {
        let (theta, phi) = (i as f32 * step, 2.0 * (j % rings) as f32 * step);
        let radius = 1.0 + 0.1 * (5.0 * theta).sin() * (4.0 * phi).cos();
        [radius * theta.sin() * phi.cos(), radius * theta.cos(), radius * theta.sin() * phi.sin()]
    };
    let cells = || (0..rings).flat_map(|i| (0..rings).map(move |j| (i, j)));
    let positions: Vec<_> = (0..=rings).flat_map(|i| (0..rings).map(move |j| position(i, j))).collect();
    let at = |i: u32, j: u32| i * rings + j % rings;
    let corners = |(i, j)| [at(i, j), at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)];
    (positions, cells().map(corners).flat_map(|[a, b, c, d]| [[a, b, c], [b, d, c]]).collect())
}

fn glb(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let (nodes, meshes) = (json!([{"mesh": 0}]), json!([mesh()]));
    glb_of(positions, triangles, (&nodes, &meshes))
}

/// A mesh with all triangles of a file.
fn mesh() -> Value {
    json!({"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})
}

fn glb_of(positions: &[[f32; 3]], triangles: &[[u32; 3]], (nodes, meshes): (&Value, &Value)) -> Vec<u8> {
    let roots: Vec<usize> = (0..nodes.as_array().map_or(0, Vec::len)).collect();
    let mut binary: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let split = binary.len();
    binary.extend(triangles.iter().flatten().flat_map(|i| i.to_le_bytes()));
    let bound = |pick: fn(f32, f32) -> f32| {
        positions.iter().copied().reduce(|a, b| std::array::from_fn(|k| pick(a[k], b[k]))).expect("not empty")
    };
    let mut json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes,
        "meshes": meshes,
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": split},
            {"buffer": 0, "byteOffset": split, "byteLength": binary.len() - split},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": positions.len(),
             "min": bound(f32::min), "max": bound(f32::max)},
            {"bufferView": 1, "componentType": 5125, "type": "SCALAR", "count": 3 * triangles.len()},
        ],
    })
    .to_string()
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut glb = Vec::new();
    glb.extend(b"glTF");
    for word in [2, (28 + json.len() + binary.len()) as u32, json.len() as u32] {
        glb.extend(word.to_le_bytes());
    }
    glb.extend(b"JSON");
    glb.extend(json);
    glb.extend((binary.len() as u32).to_le_bytes());
    glb.extend(b"BIN\0");
    glb.extend(binary);
    glb
}
