//! The model that is baked where the user names none.

use serde_json::json;
use simpliguard::gltf::binary;

use crate::error::UsageError;

/// A torus with bumps and stripes, as a binary glTF of at least `triangles` triangles: curved in both directions, with a hole,
/// and with colours to fit.
pub(super) fn torus(triangles: u32) -> Result<Vec<u8>, UsageError> {
    // Vertices along each of the two circles.
    let samples = triangles.div_ceil(2).isqrt().max(3) + 1;
    let [positions, colors] = vertices(samples);
    let corner = |i: u32, dx: u32, dy: u32| (i % samples + dx) % samples + (i / samples + dy) % samples * samples;
    let quad = |i: u32| [[0, 0], [0, 1], [1, 1], [0, 0], [1, 1], [1, 0]].map(|[dx, dy]| corner(i, dx, dy));
    let indices: Vec<u8> = (0..samples * samples).flat_map(quad).flat_map(u32::to_le_bytes).collect();
    let bytes = |values: &[f32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let parts = [bytes(&positions), bytes(&colors), indices];
    let mut offset = 0;
    let view = |part: &Vec<u8>| {
        let view = json!({"buffer": 0, "byteOffset": offset, "byteLength": part.len()});
        offset += part.len();
        view
    };
    let views: Vec<_> = parts.iter().map(view).collect();
    let count = samples * samples;
    let json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2}]}],
        "buffers": [{"byteLength": offset}], "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count, "min": [-1.5, -0.5, -1.5], "max": [1.5, 0.5, 1.5]},
            {"bufferView": 1, "componentType": 5126, "type": "VEC3", "count": count},
            {"bufferView": 2, "componentType": 5125, "type": "SCALAR", "count": 6 * count},
        ],
    });
    binary(&json, &parts.concat())
        .map_err(|bytes| UsageError(format!("--triangles: the model would have {bytes} bytes, 4 GiB or more")))
}

/// Positions and linear colours.
fn vertices(samples: u32) -> [Vec<f32>; 2] {
    let angle = |i: u32| i as f32 / samples as f32 * std::f32::consts::TAU;
    let [mut positions, mut colors] = [Vec::new(), Vec::new()];
    for (u, v) in (0..samples * samples).map(|i| (angle(i % samples), angle(i / samples))) {
        let tube = 0.3 + 0.02 * libm::sinf(11.0 * u) * libm::cosf(7.0 * v);
        let ring = 1.0 + tube * libm::cosf(v);
        positions.extend([ring * libm::cosf(u), tube * libm::sinf(v), ring * libm::sinf(u)]);
        colors.extend([5.0, 7.0, 9.0].map(|stripes| 0.5 + 0.4 * libm::sinf(stripes * u) * libm::cosf(4.0 * v)));
    }
    [positions, colors]
}
