//! Normals that replace those that are estimated from the facets round a vertex.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::SmoothMesh;

/// A mesh whose estimated normals are replaced, each once.
pub(super) struct Settling<'a> {
    mesh: &'a mut SmoothMesh,
    /// For each vertex, whether its normal is estimated.
    estimated: &'a mut Vec<bool>,
    /// Standard deviations of the normals, rad; empty if there are none.
    deviations: &'a mut Vec<f64>,
    is_set: Vec<bool>,
}

impl<'a> Settling<'a> {
    pub(super) fn of(
        mesh: &'a mut SmoothMesh,
        estimated: &'a mut Vec<bool>,
        deviations: &'a mut Vec<f64>,
    ) -> Self {
        let is_set = vec![false; mesh.positions.len()];
        Self { mesh, estimated, deviations, is_set }
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
                if !self.estimated[index] || self.is_set[index] {
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
                    self.estimated.push(true);
                    self.is_set.push(true);
                    replaced.push(new);
                    self.deviations.extend((!self.deviations.is_empty()).then_some(0.0));
                }
                self.mesh.triangles[triangle][corner] = new;
            }
        }
        replaced
    }
}
