//! Which elements belong together, found by pairs of them.

/// Sets that are joined two at a time (Galler & Fischer, An improved equivalence algorithm, CACM 7(5), 1964).
pub(crate) struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    /// `count` sets of one element each.
    pub(crate) fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    fn root(&mut self, element: usize) -> usize {
        let mut at = element;
        while self.parents[at] as usize != at {
            let parent = self.parents[at] as usize;
            self.parents[at] = self.parents[parent];
            at = parent;
        }
        at
    }

    /// Joins the sets of two elements; the smaller root stays, so that numbers do not depend on the order.
    pub(crate) fn join(&mut self, one: usize, two: usize) {
        let (one, two) = (self.root(one), self.root(two));
        self.parents[one.max(two)] = one.min(two) as u32;
    }

    /// For each element the number of its set, from 0 in the order of first appearance, and how many sets there are.
    pub(crate) fn numbered(mut self) -> (Vec<u32>, usize) {
        let mut count = 0;
        for element in 0..self.parents.len() {
            let parent = self.parents[element] as usize;
            // A parent is smaller than its element, so it is a number already.
            self.parents[element] = if parent == element { count } else { self.parents[parent] };
            count += u32::from(parent == element);
        }
        (self.parents, count as usize)
    }
}
