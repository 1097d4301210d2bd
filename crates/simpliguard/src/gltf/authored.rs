//! The levels of detail that a file comes with: those that `MSFT_lod` of a node lists, and nodes such as `Rock_LOD1` beside
//! `Rock_LOD0` or `Rock`.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;

/// The levels that a file has of a node.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AuthoredLevels {
    /// The node that they stand for, with all below it.
    pub(super) base: usize,
    /// Their nodes, in falling detail.
    pub(super) levels: Vec<usize>,
}

/// True if a glTF has its own levels of detail.
pub fn has_levels(json: &Value) -> bool {
    let list = |name: &str| json.get(name).and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    list("extensionsUsed").iter().any(|name| name == "MSFT_lod") || !authored_levels(list("nodes")).is_empty()
}

/// The levels among the nodes of a document, by the nodes that they stand for.
pub(super) fn authored_levels(nodes: &[Value]) -> Vec<AuthoredLevels> {
    let tree = Tree::of(nodes);
    let mut found: BTreeMap<usize, Vec<usize>> = listed(nodes);
    let listed: BTreeSet<usize> = found.values().flatten().copied().collect();
    for (base, levels) in tree.named() {
        if !found.contains_key(&base) && levels.iter().all(|level| !listed.contains(level)) {
            found.insert(base, levels);
        }
    }
    let group = |(base, levels): (usize, Vec<usize>)| {
        let apart = |&level: &usize| level != base && !tree.is_under(base, level);
        let levels: Vec<usize> = levels.into_iter().filter(apart).collect();
        (!levels.is_empty() && tree.shows(base, &levels)).then_some(AuthoredLevels { base, levels })
    };
    found.into_iter().filter_map(group).collect()
}

/// The nodes of all levels, with those below them.
pub(super) fn level_nodes(nodes: &[Value]) -> BTreeSet<usize> {
    let mut open: Vec<usize> = authored_levels(nodes).into_iter().flat_map(|authored| authored.levels).collect();
    let mut all = BTreeSet::new();
    while let Some(node) = open.pop() {
        if all.insert(node) {
            open.extend(children(nodes, node));
        }
    }
    all
}

/// The levels that `MSFT_lod` lists, by their nodes.
fn listed(nodes: &[Value]) -> BTreeMap<usize, Vec<usize>> {
    let ids = |node: &Value| {
        let ids = node.pointer("/extensions/MSFT_lod/ids")?.as_array()?.iter().filter_map(Value::as_u64);
        Some(ids.filter_map(|id| usize::try_from(id).ok().filter(|id| *id < nodes.len())).collect())
    };
    nodes.iter().enumerate().filter_map(|(index, node)| Some((index, ids(node)?))).collect()
}

/// A name that ends in `_LOD` and a number, and maybe in the `.001` that Blender gives a copy.
struct LevelName {
    /// What levels of one node share, in lower case: the name without the end, with the number of the copy.
    stem: String,
    number: u32,
}

impl LevelName {
    fn parse(name: &str) -> Option<Self> {
        let digits = |text: &str| text.len() - text.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        let (name, copy) = match name.len() - digits(name) {
            at if name[..at].ends_with('.') && at < name.len() => name.split_at(at - 1),
            _ => (name, ""),
        };
        let (stem, number) = name.split_at(name.len() - digits(name));
        let stem_end = stem.len().checked_sub(4).filter(|&at| stem.is_char_boundary(at))?;
        let (stem, end) = stem.split_at(stem_end);
        let number = number.parse().ok().filter(|_| end.eq_ignore_ascii_case("_lod") && !stem.is_empty())?;
        Some(Self { stem: format!("{stem}{copy}").to_lowercase(), number })
    }
}

/// The node tree of a document, as far as it makes sense.
struct Tree<'a> {
    nodes: &'a [Value],
    parent: Vec<Option<usize>>,
}

impl<'a> Tree<'a> {
    fn of(nodes: &'a [Value]) -> Self {
        let mut parent = vec![None; nodes.len()];
        for node in 0..nodes.len() {
            children(nodes, node).for_each(|child| parent[child] = Some(node));
        }
        Self { nodes, parent }
    }

    /// The levels by name, by the nodes that they stand for. Nodes of one stem below one parent belong together; where
    /// copies have equal names, the first one of a number belongs to the first one of the next.
    fn named(&self) -> BTreeMap<usize, Vec<usize>> {
        let mut families: BTreeMap<(Option<usize>, String), BTreeMap<u32, Vec<usize>>> = BTreeMap::new();
        let levels = (0..self.nodes.len()).filter_map(|node| Some((node, LevelName::parse(self.name(node)?)?)));
        for (node, LevelName { stem, number }) in levels {
            families.entry((self.parent[node], stem)).or_default().entry(number).or_default().push(node);
        }
        if families.is_empty() {
            return BTreeMap::new();
        }
        for node in 0..self.nodes.len() {
            let family = self.name(node).and_then(|name| families.get_mut(&(self.parent[node], name.to_lowercase())));
            // A node without an end is the source if there is no number zero.
            if let Some(family) = family.filter(|family| !family.contains_key(&0)) {
                family.entry(0).or_default().push(node);
            }
        }
        families.into_iter().flat_map(|((parent, stem), family)| self.family(parent, &stem, family)).collect()
    }

    /// The levels of the nodes of one stem below one parent. If none of them is the source, it is the parent of that name
    /// with a mesh of its own, or else their most detailed level.
    fn family(
        &self,
        parent: Option<usize>,
        stem: &str,
        mut numbers: BTreeMap<u32, Vec<usize>>,
    ) -> Vec<(usize, Vec<usize>)> {
        let is_source = |&parent: &usize| {
            self.nodes[parent].get("mesh").is_some()
                && self.name(parent).is_some_and(|name| name.to_lowercase() == stem)
        };
        if let Some(parent) = parent.filter(is_source).filter(|_| !numbers.contains_key(&0)) {
            numbers.insert(0, vec![parent]);
        }
        let mut numbers = numbers.into_values();
        let Some(bases) = numbers.next() else { return Vec::new() };
        let levels: Vec<Vec<usize>> = numbers.collect();
        let of_base = |(copy, base)| (base, levels.iter().filter_map(|level| level.get(copy).copied()).collect());
        bases.into_iter().enumerate().map(of_base).collect()
    }

    fn name(&self, node: usize) -> Option<&'a str> {
        self.nodes[node].get("name")?.as_str()
    }

    /// Tells whether a node has a mesh, or one below it that is not below one of `levels`.
    fn shows(&self, base: usize, levels: &[usize]) -> bool {
        let (mut open, mut seen) = (vec![base], BTreeSet::new());
        while let Some(node) = open.pop() {
            if levels.contains(&node) || !seen.insert(node) {
                continue;
            }
            if self.nodes[node].get("mesh").is_some() {
                return true;
            }
            open.extend(children(self.nodes, node));
        }
        false
    }

    /// Tells whether a node lies below another. The number of steps is bounded, in case the parents form a circle.
    fn is_under(&self, node: usize, ancestor: usize) -> bool {
        let way = std::iter::successors(Some(node), |&node| self.parent[node]).take(self.nodes.len() + 1);
        way.skip(1).any(|node| node == ancestor)
    }
}

fn children(nodes: &[Value], node: usize) -> impl Iterator<Item = usize> {
    let list = nodes[node].get("children").and_then(Value::as_array).into_iter().flatten();
    list.filter_map(|child| usize::try_from(child.as_u64()?).ok()).filter(|&child| child < nodes.len())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// Nodes without children have a mesh.
    fn document(mut nodes: Value) -> Vec<Value> {
        let nodes = nodes.as_array_mut().expect("a list");
        for node in nodes.iter_mut().filter(|node| node.is_object() && node.get("children").is_none()) {
            node["mesh"] = json!(0);
        }
        nodes.clone()
    }

    fn found(nodes: Value) -> Vec<(usize, Vec<usize>)> {
        authored_levels(&document(nodes)).into_iter().map(|AuthoredLevels { base, levels }| (base, levels)).collect()
    }

    #[test]
    fn names_of_levels_have_a_stem_and_a_number() {
        let parse = |name: &str| LevelName::parse(name).map(|level| (level.stem, level.number));
        assert_eq!(parse("Rock_LOD1"), Some(("rock".into(), 1)));
        assert_eq!(parse("Rock_lod12.003"), Some(("rock.003".into(), 12)));
        for name in
            ["Rock", "LOD1", "_LOD1", "Rock_LOD", "Explode1", "\u{e9}\u{e9}1", "1", ".1", "", "Rock_LOD1.", "a.b"]
        {
            assert_eq!(parse(name), None, "{name}");
        }
    }

    #[test]
    fn levels_by_name_stand_for_the_first_of_their_stem() {
        let nodes = json!([
            { "name": "Rock_LOD2" }, { "name": "Rock_LOD0" }, { "name": "rock_lod1" }, { "name": "Tree" }, { "name": "Tree_LOD1" },
            { "name": "Bush_LOD1" }, { "name": "Bush_LOD3" }, { "name": "Lone_LOD1" }, { "name": "Rock_LOD1.001" },
            { "name": "Rock.001" },
        ]);
        assert_eq!(found(nodes.clone()), [(1, vec![2, 0]), (3, vec![4]), (5, vec![6]), (9, vec![8])]);
        let nodes = document(nodes);
        assert_eq!(level_nodes(&nodes), BTreeSet::from([0, 2, 4, 6, 8]));
        assert!(has_levels(&json!({ "nodes": nodes })) && has_levels(&json!({ "extensionsUsed": ["MSFT_lod"] })));
        let lone = json!([{ "name": "Tree", "mesh": 0 }, { "name": "Lone_LOD1", "mesh": 0 }]);
        assert!(!has_levels(&json!({ "nodes": lone })));
        // What would leave nothing of the model is no level.
        assert!(!has_levels(&json!({ "nodes": [{ "name": "Tree" }, { "name": "Tree_LOD1", "mesh": 0 }] })));
    }

    #[test]
    fn copies_of_equal_names_pair_in_their_order() {
        let nodes = json!([{ "name": "a_LOD0" }, { "name": "a_LOD1" }, { "name": "a_LOD0" }, { "name": "a_LOD1" }]);
        assert_eq!(found(nodes), [(0, vec![1]), (2, vec![3])]);
        let short = json!([{ "name": "a_LOD0" }, { "name": "a_LOD1" }, { "name": "a_LOD0" }]);
        assert_eq!(found(short), [(0, vec![1])]);
    }

    #[test]
    fn families_are_those_of_one_parent() {
        let below_groups = json!([
            { "name": "a", "children": [1, 2] }, { "name": "a_LOD0", "mesh": 0 }, { "name": "a_LOD1", "children": [3] },
            { "mesh": 1 }, { "name": "b", "mesh": 2, "children": [5] }, { "name": "b_LOD1" }, { "name": "c", "children": [7] },
            { "name": "c_LOD1" },
        ]);
        assert_eq!(found(below_groups.clone()), [(1, vec![2]), (4, vec![5])]);
        assert_eq!(level_nodes(&document(below_groups)), BTreeSet::from([2, 3, 5]));
    }

    #[test]
    fn an_extension_lists_levels_and_nonsense_is_left_out() {
        let lod = |ids: Value| json!({ "MSFT_lod": { "ids": ids } });
        let nodes = json!([
            { "name": "a_LOD0", "extensions": lod(json!([2, 1, 99, "x", 0])) }, { "name": "a_LOD2" }, { "name": "a_LOD1" },
            { "children": [4], "extensions": lod(json!([])) }, { "children": [3], "extensions": lod(json!([3])) },
        ]);
        assert_eq!(found(nodes), [(0, vec![2, 1])]);
        assert!(found(json!([{ "name": 3, "children": [0, -1, 7] }, 5, null])).is_empty());
    }
}
