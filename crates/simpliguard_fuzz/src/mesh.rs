//! Triangles among few vertices: everything touches everything.

use glam::Vec3;
use simpliguard::Cancellation;
use simpliguard::data::TriMesh;
use simpliguard::geometry::Topology;
use simpliguard::simplify;
use simpliguard::unwrap::{UnwrapParams, unwrap as make_atlas};

/// Vertices lie on a grid of so many places along each side.
const PLACES: u8 = 4;
/// Most triangles to collapse, and to unwrap, which takes longer.
const MOST: [usize; 2] = [200, 30];
/// Side of the atlas in texels.
const ATLAS: u32 = 32;

/// A mesh whose triangles have their corners on a small grid: three bytes a triangle.
fn soup(bytes: &[u8], most: usize) -> TriMesh {
    let places = u32::from(PLACES);
    let place = |v: u32| Vec3::new((v % places) as f32, (v / places % places) as f32, (v / places / places) as f32);
    let corner = |byte: u8| u32::from(byte % PLACES.pow(3));
    let triangles = bytes.as_chunks::<3>().0.iter().take(most).map(|t| t.map(corner)).collect();
    TriMesh { positions: (0..places.pow(3)).map(place).collect(), triangles }
}

/// Cuts triangles into a manifold and collapses it. The result is a manifold within its budget, or cannot be smaller.
pub fn collapse(bytes: &[u8]) {
    let Some((&budget, rest)) = bytes.split_first() else { return };
    let mesh = simplify::manifold(&soup(rest, MOST[0]));
    let before = Topology::of(&mesh);
    assert!(before.is_manifold(), "{before:?}");
    let level = simplify::collapse(&mesh, usize::from(budget));
    assert!(level.triangles.len() <= mesh.triangles.len());
    assert!(level.positions.iter().all(|p| p.is_finite()), "a position is not finite");
    let after = Topology::of(&level);
    assert!(after.is_manifold() && after.degenerate <= before.degenerate, "{before:?} {after:?}");
}

/// Unwraps triangles as they are. The atlas is sound.
pub fn unwrap(bytes: &[u8]) {
    let mesh = soup(bytes, MOST[1]);
    let params = UnwrapParams { size: ATLAS, ..UnwrapParams::default() };
    let atlas = make_atlas(&mesh, None, &params, &Cancellation::default());
    atlas.validate(mesh.triangles.len()).expect("it is sound");
}
