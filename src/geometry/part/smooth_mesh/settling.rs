//! Normals that replace those that are estimated from the facets round a vertex.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SmoothMesh;

/// Which normals of a mesh are estimated, and how well they are known.
pub(super) struct Estimates {
    /// For each vertex, whether its normal is estimated.
    pub(super) is_estimated: Vec<bool>,
    /// Standard deviations of the normals, rad; empty if there are none.
    deviations: Vec<f64>,
}

impl Estimates {
    /// Of vertices whose normals have these standard deviations, rad; none if the list is empty.
    pub(super) fn new(is_estimated: Vec<bool>, deviations: Vec<f64>) -> Self {
        Self { is_estimated, deviations }
    }

    /// The standard deviation of the normal at a vertex, rad.
    pub(super) fn deviation(&self, vertex: u32) -> f64 {
        self.deviations.get(vertex as usize).copied().unwrap_or(0.0)
    }

    /// Adds a vertex whose normal has no deviation.
    pub(super) fn push(&mut self, is_estimated: bool) {
        self.is_estimated.push(is_estimated);
        self.deviations.extend((!self.deviations.is_empty()).then_some(0.0));
    }

    /// Takes the estimate at a vertex for exact; it is still one.
    pub(super) fn trust(&mut self, vertex: u32) {
        if let Some(deviation) = self.deviations.get_mut(vertex as usize) {
            *deviation = 0.0;
        }
    }

    /// Takes the normal at a vertex for one that is as exact as those of a file, and is not estimated any more.
    pub(super) fn set_known(&mut self, vertex: u32) {
        self.is_estimated[vertex as usize] = false;
        self.trust(vertex);
    }
}

/// A mesh whose estimated normals are replaced, each once.
pub(super) struct Settling<'a> {
    mesh: &'a mut SmoothMesh,
    estimates: &'a mut Estimates,
    is_set: Vec<bool>,
}

impl<'a> Settling<'a> {
    pub(super) fn of(mesh: &'a mut SmoothMesh, estimates: &'a mut Estimates) -> Self {
        let is_set = vec![false; mesh.positions.len()];
        Self { mesh, estimates, is_set }
    }

    /// Replaces the normals at the vertices of some triangles. Those `at_edges`, in ascending order, get vertices of their own: the
    /// facets beyond keep what they have. Returns the vertices whose normals were replaced.
    pub(super) fn set(
        &mut self,
        triangles: &[usize],
        at_edges: &[u32],
        normal: impl Fn(&SmoothMesh, u32) -> Option<Vector3<f64>>,
    ) -> Vec<u32> {
        let mut replaced = Vec::new();
        let mut own: BTreeMap<u32, u32> = BTreeMap::new();
        for &triangle in triangles {
            for corner in 0..3 {
                let vertex = self.mesh.triangles[triangle][corner];
                let index = vertex as usize;
                if !self.estimates.is_estimated[index] || self.is_set[index] {
                    continue;
                }
                let Some(normal) = normal(self.mesh, vertex) else { continue };
                if at_edges.binary_search(&vertex).is_err() {
                    self.mesh.normals[index] = normal;
                    self.is_set[index] = true;
                    replaced.push(vertex);
                    continue;
                }
                let new = *own.entry(vertex).or_insert(self.mesh.positions.len() as u32);
                if new as usize == self.mesh.positions.len() {
                    self.mesh.positions.push(self.mesh.positions[index]);
                    self.mesh.normals.push(normal);
                    self.estimates.push(true);
                    self.is_set.push(true);
                    replaced.push(new);
                }
                self.mesh.triangles[triangle][corner] = new;
            }
        }
        replaced
    }
}
