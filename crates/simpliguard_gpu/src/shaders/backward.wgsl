// Backward pass, from the gradient at the pixels to the vertices. Mirrors refine/backward.rs.

// Carries the gradient to the pixels before antialiasing.
@compute @workgroup_size(16, 16)
fn backward_blends(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let pixel = pixel_of(group, local);
    if !is_within(pixel) {
        return;
    }
    let i = index_of(pixel);
    let own = image_gradient[i];
    var gradient = own;
    for (var direction = 0u; direction < 4u; direction++) {
        let next = neighbour(pixel, direction);
        if !next.exists {
            continue;
        }
        let inwards = blend_of(i, direction);
        if inwards.exists {
            // The blend changes the near pixel, or else the far one.
            if inwards.reach < 0.5 {
                gradient -= own * (0.5 - inwards.reach);
            } else {
                gradient += image_gradient[next.index] * (inwards.reach - 0.5);
            }
        }
        let outwards = blend_of(next.index, opposite(direction));
        if outwards.exists {
            if outwards.reach < 0.5 {
                gradient += image_gradient[next.index] * (0.5 - outwards.reach);
            } else {
                gradient -= own * (outwards.reach - 0.5);
            }
        }
    }
    base_gradient[i] = gradient;
}

// Gradient at the corners of triangle `t` in clip space (x, y, w), from the gradient at one of its pixels.
fn by_corners(t: u32, setup: Setup, pixel: vec2<u32>, gradient: vec4<f32>) -> array<vec3<f32>, 3> {
    let ndc = ndc_of(pixel);
    let at = barycentric_at(setup, ndc);
    let lookup = lookup_at(uv_at(t, at.xyz), params.texture_size);
    let k = lookup.texel;
    let t00 = texels[k];
    let t10 = texels[k + 1u];
    let t01 = texels[k + params.texture_size];
    let t11 = texels[k + params.texture_size + 1u];
    let along = vec2<f32>(
        dot(gradient, (t10 - t00) * (1.0 - lookup.y) + (t11 - t01) * lookup.y),
        dot(gradient, (t01 - t00) * (1.0 - lookup.x) + (t11 - t10) * lookup.x),
    );
    let uvs = triangles[t].uvs;
    let by_b = vec3<f32>(dot(along, uvs[0]), dot(along, uvs[1]), dot(along, uvs[2]));
    // b = a / sum(a)
    let by_a = (by_b - dot(by_b, at.xyz)) * at.w;
    // a_0 = p_1 x p_2 and so on, with p_i = (x_i, y_i) - w_i * pixel
    let corners = triangles[t].vertices;
    let c0 = vertices[corners[0]].clip;
    let c1 = vertices[corners[1]].clip;
    let c2 = vertices[corners[2]].clip;
    let p0 = c0.xy - ndc * c0.w;
    let p1 = c1.xy - ndc * c1.w;
    let p2 = c2.xy - ndc * c2.w;
    let g0 = vec2<f32>(by_a.z * p1.y - by_a.y * p2.y, by_a.y * p2.x - by_a.z * p1.x);
    let g1 = vec2<f32>(by_a.x * p2.y - by_a.z * p0.y, by_a.z * p0.x - by_a.x * p2.x);
    let g2 = vec2<f32>(by_a.y * p0.y - by_a.x * p1.y, by_a.x * p1.x - by_a.y * p0.x);
    return array<vec3<f32>, 3>(
        vec3<f32>(g0, -dot(ndc, g0)),
        vec3<f32>(g1, -dot(ndc, g1)),
        vec3<f32>(g2, -dot(ndc, g2)),
    );
}

var<workgroup> corner_sums: array<array<vec3<f32>, 3>, 64>;

// Each workgroup sums over the pixels of one triangle.
@compute @workgroup_size(64)
fn backward_shading(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let t = linear(group, groups, 1u, 0u);
    var sum = array<vec3<f32>, 3>();
    if t < params.triangles && setups[t].is_drawn != 0u {
        let setup = setups[t];
        let left = min(min(setup.low.x, setup.middle.x), setup.high.x);
        let right = max(max(setup.low.x, setup.middle.x), setup.high.x);
        let low = vec2<f32>(params.rect.xy);
        let high = vec2<f32>(params.rect.zw);
        let first = vec2<u32>(clamp(ceil(vec2<f32>(left, setup.low.y)), low, high));
        let end = vec2<u32>(clamp(ceil(vec2<f32>(right, setup.high.y)), low, high));
        let columns = max(end.x, first.x) - first.x;
        let pixels = columns * (max(end.y, first.y) - first.y);
        for (var p = local; p < pixels; p += 64u) {
            let pixel = first + vec2<u32>(p % columns, p / columns);
            let i = index_of(pixel);
            if ids[i] == t {
                let add = by_corners(t, setup, pixel, base_gradient[i]);
                sum[0] += add[0];
                sum[1] += add[1];
                sum[2] += add[2];
            }
        }
    }
    corner_sums[local] = sum;
    workgroupBarrier();
    for (var half = 32u; half > 0u; half = half / 2u) {
        if local < half {
            for (var k = 0u; k < 3u; k++) {
                corner_sums[local][k] += corner_sums[local + half][k];
            }
        }
        workgroupBarrier();
    }
    if local < 3u && t < params.triangles {
        corner_gradients[3u * t + local] = vec4<f32>(corner_sums[0][local], 0.0);
    }
}

// Carries the gradients of the crossings of one half-edge to its ends.
@compute @workgroup_size(64)
fn backward_edges(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let edge = linear(group, groups, 64u, local);
    if edge >= 3u * params.triangles {
        return;
    }
    let corners = triangles[edge / 3u].vertices;
    let clip_a = vertices[corners[edge % 3u]].clip;
    let clip_b = vertices[corners[(edge % 3u + 1u) % 3u]].clip;
    var at_a = vec3<f32>(0.0);
    var at_b = vec3<f32>(0.0);
    let walk = walk_of(edge / 3u, edge % 3u);
    if walk.is_silhouette {
        let height = walk.end.y - walk.start.y;
        let slope = (walk.end.x - walk.start.x) / height;
        for (var row = walk.first_row; f32(row) <= walk.last; row++) {
            let crossing = crossing_of(walk, row);
            let k = 4u * crossing.near + crossing.direction;
            if !crossing.exists || atomicLoad(&edges[k]) != edge {
                continue;
            }
            let is_near = bitcast<f32>(atomicLoad(&reach[k])) < 0.5;
            let difference = base[crossing.near] - base[crossing.far];
            let sign = select(-1.0, 1.0, (crossing.direction & 1u) == 0u);
            let gradient = dot(image_gradient[select(crossing.far, crossing.near, is_near)], difference) * sign;
            // crossing = a.x + (b.x - a.x) * t with t = (row - a.y) / (b.y - a.y)
            let t = (f32(row) - walk.start.y) / height;
            at_a += by_end(vec2<f32>(1.0 - t, slope * (t - 1.0)) * gradient, walk.is_horizontal, clip_a);
            at_b += by_end(vec2<f32>(t, -slope * t) * gradient, walk.is_horizontal, clip_b);
        }
    }
    end_gradients[2u * edge] = vec4<f32>(at_a, 0.0);
    end_gradients[2u * edge + 1u] = vec4<f32>(at_b, 0.0);
}

fn by_end(by_pixel: vec2<f32>, is_horizontal: bool, clip: vec4<f32>) -> vec3<f32> {
    let scaled = select(by_pixel.yx, by_pixel, is_horizontal) * (0.5 * f32(params.size) / clip.w);
    return vec3<f32>(scaled, -(scaled.x * clip.x + scaled.y * clip.y) / clip.w);
}

// Sums over the corners of each vertex, in their order.
@compute @workgroup_size(64)
fn gather_vertices(@builtin(global_invocation_id) id: vec3<u32>) {
    let v = id.x;
    if v >= params.vertices {
        return;
    }
    var sum = vec3<f32>(0.0);
    for (var j = incidence[v]; j < incidence[v + 1u]; j++) {
        let corner = incidence[j];
        // The edge that ends at this corner begins at the one before.
        let first = corner - corner % 3u;
        let before = first + (corner - first + 2u) % 3u;
        sum += corner_gradients[corner].xyz;
        sum += end_gradients[2u * corner].xyz;
        sum += end_gradients[2u * before + 1u].xyz;
    }
    vertex_gradients[v] = vec4<f32>(sum, 0.0);
}
