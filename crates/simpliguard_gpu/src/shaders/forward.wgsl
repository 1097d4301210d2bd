// Forward pass: visibility, texture lookup, antialiasing of silhouettes. Mirrors refine/forward.rs and render/raster.rs.

// True if `a` is higher than `b`, or as high and farther right: the two triangles at an edge must order it alike.
fn is_higher(a: vec2<f32>, b: vec2<f32>) -> bool {
    return a.y > b.y || (a.y == b.y && a.x > b.x);
}

fn coefficients(p: vec4<f32>, q: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(p.x * q.y - p.y * q.x, p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w, 0.0);
}

@compute @workgroup_size(64)
fn set_up(@builtin(global_invocation_id) id: vec3<u32>) {
    let t = id.x;
    if t >= params.triangles {
        return;
    }
    let corners = triangles[t].vertices;
    let v0 = vertices[corners[0]];
    let v1 = vertices[corners[1]];
    let v2 = vertices[corners[2]];
    let a = v0.pixel.xyz;
    let b = v1.pixel.xyz;
    let c = v2.pixel.xyz;
    var setup: Setup;
    setup.k0 = coefficients(v1.clip, v2.clip);
    setup.k1 = coefficients(v2.clip, v0.clip);
    setup.k2 = coefficients(v0.clip, v1.clip);
    let area = cross_2d(b.xy - a.xy, c.xy - a.xy);
    setup.is_facing = u32(area > 0.0);
    let is_in_front = v0.clip.w > 0.0 && v1.clip.w > 0.0 && v2.clip.w > 0.0;
    let is_shown = area > 1e-12 || (area < -1e-12 && params.double_sided != 0u);
    setup.is_drawn = u32(is_in_front && is_shown);
    let zx = ((b.z - a.z) * (c.y - a.y) - (c.z - a.z) * (b.y - a.y)) / area;
    let zy = ((c.z - a.z) * (b.x - a.x) - (b.z - a.z) * (c.x - a.x)) / area;
    setup.plane = vec4<f32>(a.z - zx * a.x - zy * a.y, zx, zy, 0.0);
    var low = a.xy;
    var middle = b.xy;
    var high = c.xy;
    if is_higher(low, middle) {
        let other = low;
        low = middle;
        middle = other;
    }
    if is_higher(middle, high) {
        let other = middle;
        middle = high;
        high = other;
    }
    if is_higher(low, middle) {
        let other = low;
        low = middle;
        middle = other;
    }
    setup.low = low;
    setup.middle = middle;
    setup.high = high;
    setups[t] = setup;
}

fn edge_at(low: vec2<f32>, high: vec2<f32>, y: f32) -> f32 {
    let height = high.y - low.y;
    if height <= 0.0 {
        return high.x;
    }
    return low.x + (high.x - low.x) * ((y - low.y) / height);
}

fn covers(setup: Setup, pixel: vec2<f32>) -> bool {
    if pixel.y < setup.low.y || pixel.y >= setup.high.y {
        return false;
    }
    let long = edge_at(setup.low, setup.high, pixel.y);
    let is_below = pixel.y < setup.middle.y;
    let short = edge_at(
        select(setup.middle, setup.low, is_below),
        select(setup.high, setup.middle, is_below),
        pixel.y,
    );
    return pixel.x >= min(long, short) && pixel.x < max(long, short);
}

var<workgroup> listed: array<u32, 256>;
var<workgroup> count: atomic<u32>;

// Each workgroup draws a tile. It lists the triangles that may touch it, 256 at a time, and each pixel tests them.
@compute @workgroup_size(16, 16)
fn rasterise(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let pixel = pixel_of(group, local);
    let at = vec2<f32>(pixel);
    let first = vec2<f32>((params.first_tile + group.xy) * TILE);
    let last = first + f32(TILE - 1u);
    var nearest = 3.40282347e38;
    var id = EMPTY_PIXEL;
    for (var start = 0u; start < params.triangles; start += 256u) {
        if index == 0u {
            atomicStore(&count, 0u);
        }
        workgroupBarrier();
        let t = start + index;
        if t < params.triangles {
            let setup = setups[t];
            let left = min(min(setup.low.x, setup.middle.x), setup.high.x);
            let right = max(max(setup.low.x, setup.middle.x), setup.high.x);
            let touches = left <= last.x && right >= first.x && setup.low.y <= last.y && setup.high.y >= first.y;
            if setup.is_drawn != 0u && touches {
                listed[atomicAdd(&count, 1u)] = t;
            }
        }
        workgroupBarrier();
        let listed_count = atomicLoad(&count);
        for (var k = 0u; k < listed_count; k++) {
            let candidate = listed[k];
            let setup = setups[candidate];
            if covers(setup, at) {
                let z = setup.plane.x + setup.plane.z * at.y + setup.plane.y * at.x;
                // The order of the list is not fixed; the result is.
                if z < nearest || (z == nearest && candidate < id) {
                    nearest = z;
                    id = candidate;
                }
            }
        }
        workgroupBarrier();
    }
    if pixel.x < params.size && pixel.y < params.size {
        ids[index_of(pixel)] = id;
        depth[index_of(pixel)] = nearest;
    }
}

// Looks the texture up at every pixel.
@compute @workgroup_size(16, 16)
fn shade(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let pixel = pixel_of(group, local);
    if !is_within(pixel) {
        return;
    }
    let i = index_of(pixel);
    let id = ids[i];
    var color = vec4<f32>(0.0);
    if id != EMPTY_PIXEL {
        let barycentric = barycentric_at(setups[id], ndc_of(pixel)).xyz;
        let lookup = lookup_at(uv_at(id, barycentric), params.texture_size);
        let weights = weights_of(lookup);
        let k = lookup.texel;
        color = texels[k] * weights.x
            + texels[k + 1u] * weights.y
            + texels[k + params.texture_size] * weights.z
            + texels[k + params.texture_size + 1u] * weights.w;
    }
    base[i] = color;
}

// Applies the blends to the colours.
@compute @workgroup_size(16, 16)
fn blend(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let pixel = pixel_of(group, local);
    if !is_within(pixel) {
        return;
    }
    let i = index_of(pixel);
    let own = base[i];
    var color = own;
    for (var direction = 0u; direction < 4u; direction++) {
        let next = neighbour(pixel, direction);
        if !next.exists {
            continue;
        }
        let inwards = blend_of(i, direction);
        if inwards.exists && inwards.reach < 0.5 {
            color -= (own - base[next.index]) * (0.5 - inwards.reach);
        }
        let outwards = blend_of(next.index, opposite(direction));
        if outwards.exists && outwards.reach >= 0.5 {
            color += (base[next.index] - own) * (outwards.reach - 0.5);
        }
    }
    image[i] = color;
}
