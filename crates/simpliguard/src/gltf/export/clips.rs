//! Changes to the clips: lost targets, and morph weights of the levels.

use serde_json::{Value, json};

use super::builder::{BufferTarget, Builder, Component, Kind, index};

/// Drops the channels that have lost their target: morph weights of nodes without `keeps_mesh`, and pointers into the
/// document, whose indices have changed. A clip without any channel left keeps its index and its length: it holds
/// `constant_node` at its place, since glTF allows no empty clip.
pub(in crate::gltf) fn drop_lost_channels(out: &mut Builder, keeps_mesh: impl Fn(usize) -> bool, constant_node: usize) {
    for clip in 0..out.all(Kind::Animation).len() {
        let animation = &out.all(Kind::Animation)[clip];
        let channels = animation.get("channels").and_then(Value::as_array).cloned().unwrap_or_default();
        let kept: Vec<Value> = channels.iter().filter(|c| keeps_target(c, &keeps_mesh)).cloned().collect();
        if kept.len() == channels.len() {
            continue;
        }
        let (channels, samplers) = if kept.is_empty() {
            let duration = duration(out, &out.all(Kind::Animation)[clip]);
            (vec![constant_channel(constant_node)], vec![constant_sampler(out, duration)])
        } else {
            used_samplers(&out.all(Kind::Animation)[clip], kept)
        };
        let animation = &mut out.all_mut(Kind::Animation)[clip];
        if let Some(animation) = animation.as_object_mut() {
            animation.insert("channels".into(), Value::Array(channels));
            animation.insert("samplers".into(), Value::Array(samplers));
        }
    }
}

/// Copies the channels of morph weights of node `driver` to each of `nodes`.
pub(in crate::gltf) fn copy_weight_channels(out: &mut Builder, driver: usize, nodes: &[usize]) {
    for animation in out.all_mut(Kind::Animation) {
        let Some(channels) = animation.get_mut("channels").and_then(Value::as_array_mut) else { continue };
        let drives = |channel: &&Value| {
            channel.get("target").is_some_and(|target| {
                target.get("path").and_then(Value::as_str) == Some("weights") && index(target, "node") == Some(driver)
            })
        };
        let driving: Vec<Value> = channels.iter().filter(drives).cloned().collect();
        for (mut channel, node) in driving.iter().flat_map(|c| nodes.iter().map(move |n| (c.clone(), *n))) {
            channel["target"]["node"] = json!(node);
            channels.push(channel);
        }
    }
}

/// True if the document has clips.
pub(in crate::gltf) fn has_clips(out: &Builder) -> bool {
    !out.all(Kind::Animation).is_empty()
}

/// The nodes whose transform a clip changes.
pub(in crate::gltf) fn moved_nodes(out: &Builder) -> Vec<usize> {
    let channels = out.all(Kind::Animation).iter().filter_map(|a| a.get("channels")?.as_array()).flatten();
    channels.filter(|c| keeps_target(c, &|_| false)).filter_map(|c| index(c.get("target")?, "node")).collect()
}

fn keeps_target(channel: &Value, keeps_mesh: &impl Fn(usize) -> bool) -> bool {
    let target = channel.get("target").unwrap_or(&Value::Null);
    match target.get("path").and_then(Value::as_str) {
        Some("weights") => index(target, "node").is_some_and(keeps_mesh),
        Some("pointer") => false,
        _ => true,
    }
}

/// The channels with new sampler indices, and the samplers that they use.
fn used_samplers(animation: &Value, mut channels: Vec<Value>) -> (Vec<Value>, Vec<Value>) {
    let all = animation.get("samplers").and_then(Value::as_array).cloned().unwrap_or_default();
    let mut place = vec![None; all.len()];
    let mut samplers = Vec::new();
    for channel in &mut channels {
        let Some(sampler) = index(channel, "sampler").filter(|&s| s < all.len()) else { continue };
        let at = *place[sampler].get_or_insert_with(|| {
            samplers.push(all[sampler].clone());
            samplers.len() - 1
        });
        channel["sampler"] = json!(at);
    }
    (channels, samplers)
}

/// Time of a clip's last key, in seconds.
fn duration(out: &Builder, animation: &Value) -> f64 {
    let samplers = animation.get("samplers").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    samplers
        .iter()
        .filter_map(|s| out.all(Kind::Accessor).get(index(s, "input")?)?.get("max")?.get(0)?.as_f64())
        .fold(0.0, f64::max)
}

fn constant_channel(node: usize) -> Value {
    json!({ "sampler": 0, "target": { "node": node, "path": "translation" } })
}

fn constant_sampler(out: &mut Builder, duration: f64) -> Value {
    let end = duration as f32;
    let times: &[f32] = if end > 0.0 { &[0.0, end] } else { &[0.0] };
    let input = out.push_accessor(times, Component::F32, "SCALAR", BufferTarget::None);
    let bounds = &mut out.all_mut(Kind::Accessor)[input];
    bounds["min"] = json!([0.0]);
    bounds["max"] = json!([times[times.len() - 1]]);
    let values = vec![[0f32; 3]; times.len()];
    let output = out.push_accessor(&values, Component::F32, "VEC3", BufferTarget::None);
    json!({ "input": input, "output": output, "interpolation": "STEP" })
}
