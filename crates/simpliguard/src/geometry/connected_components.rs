//! Connected components by union-find.
//!
//! The root of a set is its smallest element, so components and their order depend on neither the order of the joins
//! nor the number of threads.

/// Disjoint sets of the elements `0..len`: union-find with path halving (Tarjan and van Leeuwen 1984).
pub(crate) struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// One set for each element.
    pub(crate) fn new(len: usize) -> Self {
        Self((0..len as u32).collect())
    }

    /// One set for each component of vertices that triangles connect.
    fn of_vertices(vertices: usize, triangles: impl IntoIterator<Item = [u32; 3]>) -> Self {
        let mut sets = Self::new(vertices);
        for [a, b, c] in triangles {
            sets.join(a as usize, b as usize);
            sets.join(b as usize, c as usize);
        }
        sets
    }

    /// The root of the set that holds `i`: its smallest element.
    pub(crate) fn find(&mut self, mut i: usize) -> usize {
        while self.0[i] as usize != i {
            let parent = self.0[i] as usize;
            self.0[i] = self.0[parent];
            i = self.0[i] as usize;
        }
        i
    }

    /// Joins two sets under the smaller root.
    pub(crate) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }

    /// The root of each element.
    pub(crate) fn roots(mut self) -> Vec<u32> {
        (0..self.0.len()).map(|i| self.find(i) as u32).collect()
    }

    /// The elements of each set in rising order; the sets in the order of their roots.
    pub(crate) fn members(self) -> Vec<Vec<u32>> {
        group_by_component(&self.roots())
    }

    /// A number for the set of each element, and the number of sets. The numbers run from 0 in the order of the roots,
    /// which is the order in which the elements first meet their sets.
    pub(crate) fn numbered(self) -> (Vec<u32>, usize) {
        let mut numbers = self.roots();
        let mut sets = 0;
        for i in 0..numbers.len() {
            let root = numbers[i] as usize;
            numbers[i] = if root == i { sets } else { numbers[root] };
            sets += u32::from(root == i);
        }
        (numbers, sets as usize)
    }
}

/// The component of each of `vertices` vertices: the smallest vertex that is connected with it by edges.
///
/// A vertex without triangles is a component of its own. Every index must lie below `vertices`.
pub fn vertex_components(vertices: usize, triangles: impl IntoIterator<Item = [u32; 3]>) -> Vec<u32> {
    DisjointSets::of_vertices(vertices, triangles).roots()
}

/// The component of each triangle: the smallest vertex that is connected with its corners by edges.
///
/// Triangles that share only a vertex are connected. Every index must lie below `vertices`.
pub fn face_components(vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let components = vertex_components(vertices, triangles.iter().copied());
    triangles.iter().map(|t| components[t[0] as usize]).collect()
}

/// The elements of each component in rising order, given the component of each element; the components in rising order,
/// none empty.
pub fn group_by_component(components: &[u32]) -> Vec<Vec<u32>> {
    let count = components.iter().max().map_or(0, |&last| last as usize + 1);
    let mut groups = vec![Vec::new(); count];
    for (element, &component) in (0u32..).zip(components) {
        groups[component as usize].push(element);
    }
    groups.retain(|group| !group.is_empty());
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn joined(pairs: &[(usize, usize)]) -> DisjointSets {
        let mut sets = DisjointSets::new(7);
        pairs.iter().for_each(|&(a, b)| sets.join(a, b));
        sets
    }

    #[test]
    fn sets_are_named_by_their_smallest_element_and_numbered_in_that_order() {
        let sets = || joined(&[(6, 4), (5, 2), (4, 1)]);
        assert_eq!(sets().roots(), [0, 1, 2, 3, 1, 2, 1]);
        assert_eq!(sets().members(), [vec![0], vec![1, 4, 6], vec![2, 5], vec![3]]);
        assert_eq!(sets().numbered(), (vec![0, 1, 2, 3, 1, 2, 1], 4));
        assert_eq!(joined(&[(0, 1), (1, 2), (6, 3)]).numbered(), (vec![0, 0, 0, 1, 2, 3, 1], 4));
        assert_eq!(DisjointSets::new(0).numbered(), (Vec::new(), 0));
    }

    #[test]
    fn triangles_that_share_a_vertex_are_connected() {
        let triangles = [[3, 4, 5], [1, 2, 6], [5, 7, 8]];
        assert_eq!(vertex_components(10, triangles), [0, 1, 1, 3, 3, 3, 1, 3, 3, 9]);
        assert_eq!(face_components(10, &triangles), [3, 1, 3]);
        assert_eq!(group_by_component(&face_components(10, &triangles)), [vec![1], vec![0, 2]]);
        assert!(group_by_component(&[]).is_empty());
    }

    proptest! {
        #[test]
        fn the_order_of_joins_makes_no_difference(mut pairs in prop::collection::vec((0usize..7, 0usize..7), 0..8)) {
            let roots = joined(&pairs).roots();
            pairs.reverse();
            prop_assert_eq!(joined(&pairs).roots(), roots);
        }
    }
}
