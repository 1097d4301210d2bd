// Where silhouette edges pass between the centres of neighbouring pixels. Mirrors refine/silhouettes.rs.

const SAME_SURFACE: f32 = 0.2;

// 0: the blends reach as far as the outermost edge. 1: the first of the outermost edges is noted.
@group(0) @binding(20) var<uniform> pass_of_find: vec4<u32>;

// The next pixel in a direction: right, left, above, below.
struct Next {
    exists: bool,
    index: u32,
}

fn neighbour(pixel: vec2<u32>, direction: u32) -> Next {
    let i = index_of(pixel);
    switch direction {
        case 0u: { return Next(pixel.x + 1u < params.rect.z, i + 1u); }
        case 1u: { return Next(pixel.x > params.rect.x, i - 1u); }
        case 2u: { return Next(pixel.y + 1u < params.rect.w, i + params.size); }
        default: { return Next(pixel.y > params.rect.y, i - params.size); }
    }
}

fn opposite(direction: u32) -> u32 {
    return direction ^ 1u;
}

// The blend of a pixel that lies within a silhouette, with the next pixel in a direction.
struct Blend {
    exists: bool,
    reach: f32,
}

fn blend_of(near: u32, direction: u32) -> Blend {
    let k = 4u * near + direction;
    return Blend(atomicLoad(&edges[k]) != NO_EDGE, bitcast<f32>(atomicLoad(&reach[k])));
}

// Edge `k` of triangle `t` on its way through the pixels, along its minor direction.
struct Walk {
    is_silhouette: bool,
    is_horizontal: bool,
    // Ends with x across the rows, and the sign of the side that the triangle lies on.
    start: vec3<f32>,
    end: vec3<f32>,
    side: f32,
    first_row: u32,
    last: f32,
}

fn swapped(v: vec3<f32>, is_horizontal: bool) -> vec3<f32> {
    return select(v.yxz, v, is_horizontal);
}

fn walk_of(t: u32, k: u32) -> Walk {
    var walk: Walk;
    let across = triangles[t].neighbours[k];
    let is_facing = setups[t].is_facing != 0u;
    if across == NO_NEIGHBOUR {
        walk.is_silhouette = is_facing || params.double_sided != 0u;
    } else {
        walk.is_silhouette = is_facing && setups[across].is_facing == 0u;
    }
    if !walk.is_silhouette {
        return walk;
    }
    let corners = triangles[t].vertices;
    let a = vertices[corners[k]].pixel.xyz;
    let b = vertices[corners[(k + 1u) % 3u]].pixel.xyz;
    let c = vertices[corners[(k + 2u) % 3u]].pixel.xyz;
    walk.is_horizontal = abs(b.y - a.y) >= abs(b.x - a.x);
    walk.start = swapped(a, walk.is_horizontal);
    walk.end = swapped(b, walk.is_horizontal);
    let inside = swapped(c, walk.is_horizontal);
    let along = walk.end.xy - walk.start.xy;
    walk.side = cross_2d(along, inside.xy - walk.start.xy) * along.y;
    // Not a number is no side either.
    walk.is_silhouette = walk.side < 0.0 || walk.side > 0.0;
    let rows = rows_of(walk.is_horizontal);
    walk.first_row = u32(ceil(max(min(walk.start.y, walk.end.y), f32(rows.x))));
    walk.last = min(max(walk.start.y, walk.end.y), f32(rows.y) - 1.0);
    return walk;
}

fn rows_of(is_horizontal: bool) -> vec2<u32> {
    return select(params.rect.xz, params.rect.yw, is_horizontal);
}

// Where an edge crosses a row, between two pixels.
struct Crossing {
    exists: bool,
    near: u32,
    far: u32,
    direction: u32,
    reach: f32,
    depth: f32,
}

fn crossing_of(walk: Walk, row: u32) -> Crossing {
    let columns = rows_of(!walk.is_horizontal);
    let t = (f32(row) - walk.start.y) / (walk.end.y - walk.start.y);
    let x = walk.start.x + (walk.end.x - walk.start.x) * t;
    if !(x >= f32(columns.x) && x + 1.0 < f32(columns.y)) {
        return Crossing(false, 0u, 0u, 0u, 0.0, 0.0);
    }
    let first = u32(x);
    let step = select(params.size, 1u, walk.is_horizontal);
    let low = select(first * params.size + row, row * params.size + first, walk.is_horizontal);
    let axis = select(2u, 0u, walk.is_horizontal);
    let depth_there = walk.start.z + (walk.end.z - walk.start.z) * t;
    if walk.side < 0.0 {
        return Crossing(true, low + step, low, axis + 1u, max(f32(first) + 1.0 - x, 0.0), depth_there);
    }
    return Crossing(true, low, low + step, axis, x - f32(first), depth_there);
}

fn is_visible(crossing: Crossing) -> bool {
    let is_covered = ids[crossing.near] != EMPTY_PIXEL && ids[crossing.near] != ids[crossing.far];
    return is_covered
        && depth[crossing.near] < depth[crossing.far]
        && crossing.depth < depth[crossing.far]
        && abs(depth[crossing.near] - crossing.depth) < SAME_SURFACE;
}

// Forgets the blends of the last view.
@compute @workgroup_size(16, 16)
fn clear_blends(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let pixel = pixel_of(group, local);
    if !is_within(pixel) {
        return;
    }
    let i = index_of(pixel);
    for (var k = 4u * i; k < 4u * i + 4u; k++) {
        atomicStore(&reach[k], 0u);
        atomicStore(&edges[k], NO_EDGE);
    }
}

// Runs twice. One thread walks along one half-edge.
@compute @workgroup_size(64)
fn find_blends(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let edge = linear(group, groups, 64u, local);
    if edge >= 3u * params.triangles {
        return;
    }
    let walk = walk_of(edge / 3u, edge % 3u);
    if !walk.is_silhouette {
        return;
    }
    for (var row = walk.first_row; f32(row) <= walk.last; row++) {
        let crossing = crossing_of(walk, row);
        if !crossing.exists || !is_visible(crossing) {
            continue;
        }
        let k = 4u * crossing.near + crossing.direction;
        // Positive numbers are ordered as their bits are.
        let bits = bitcast<u32>(crossing.reach);
        if pass_of_find.x == 0u {
            atomicMax(&reach[k], bits);
        } else if bits == atomicLoad(&reach[k]) {
            atomicMin(&edges[k], edge);
        }
    }
}
