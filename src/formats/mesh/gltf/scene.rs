//! Walks through a glTF scene: nodes, transforms, primitives.

use std::borrow::Cow;
use std::collections::BTreeMap;

use ::gltf::Document;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Mesh, Node, Root};
use ::gltf::scene::Transform;
use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use crate::formats::Pace;
use crate::formats::mesh::clues::{Clues, RootTurn};
use crate::formats::mesh::error::{EmptyCause, VertexPlace};
use crate::formats::mesh::raw::{FrameNode, bounds_ink, hidden_notice, is_nearly};
use crate::formats::mesh::root_pose::RootPose;
use crate::formats::mesh::{
    MAX_TRIANGLES, MeshFormat, MeshReadError, NormalsFound, QUICK_TRIANGLES, RawPart, at_most, check_pace,
    normals,
};

use super::accessor::Data;
use super::draco::{self, Decoded};
use super::pose::{self, Influences, Pose, composed, unit};

/// Largest number of triangles in a small file: any number of nodes can share a mesh, and any number of primitives can
/// share an accessor.
const MAX_COPIES: usize = 2_000_000;
/// Bytes that a triangle takes in the file: three indices of two bytes. If the indices are smaller, the vertices take
/// more.
const BYTES_OF_TRIANGLE: usize = 6;
/// Bytes that a vertex takes in the file: three floats.
const BYTES_OF_VERTEX: usize = 12;
/// Largest number of instances in a file.
const MAX_INSTANCES: usize = 1_000_000;
/// The extension that hides objects.
pub(super) const VISIBILITY: &str = "KHR_node_visibility";
/// The name of the node that is the marking frame.
const FRAME: &str = "isomark";

/// Reads the file's default scene; numbers stay in the file's unit and axes.
pub(super) fn read(
    document: &Document,
    buffers: &[Cow<'_, [u8]>],
    format: MeshFormat,
    pace: Pace,
) -> Result<RawPart, MeshReadError> {
    let root = document.as_json();
    let bytes = buffers.iter().map(|buffer| buffer.len()).sum();
    let mut walk = Walk {
        root,
        data: Data { document, buffers },
        part: RawPart::new(Clues::new(format, root.asset.generator.clone())),
        skipped: BTreeMap::new(),
        used_materials: vec![false; root.materials.len()],
        has_normals: false,
        noted_triangles: 0,
        pace,
        instances: 0,
        moved: 0,
        max_triangles: capacity(bytes, BYTES_OF_TRIANGLE, MAX_COPIES).min(MAX_TRIANGLES),
        max_vertices: capacity(bytes, BYTES_OF_VERTEX, 3 * MAX_COPIES / 2).min(3 * MAX_TRIANGLES),
    };
    let roots = walk.roots()?;
    walk.part.clues.root_turn = walk.turn_of(&roots);
    if walk.part.clues.is_open_cascade() {
        let pose = walk.root_pose(&roots);
        walk.part.clues.root_pose = pose;
        if pose.is_some_and(|pose| pose.sets_upright()) {
            walk.part.clues.root_turn = RootTurn::FrontToUp;
        }
    }
    walk.nodes(roots)?;
    walk.finish_skipped();
    walk.finish()
}

struct Walk<'a> {
    /// The raw JSON; the crate's wrapper around it panics on references to missing entries.
    root: &'a Root,
    data: Data<'a>,
    part: RawPart,
    /// How often something was skipped, by its name.
    skipped: BTreeMap<&'static str, usize>,
    used_materials: Vec<bool>,
    has_normals: bool,
    /// Number of triangles for which it is known whether they are named `mark`.
    noted_triangles: usize,
    pace: Pace,
    instances: usize,
    /// Vertices that morph targets moved, and joints.
    moved: usize,
    max_triangles: usize,
    max_vertices: usize,
}

/// How many elements of `each` bytes fit into the file's bytes, but at least `copies`.
fn capacity(bytes: usize, each: usize, copies: usize) -> usize {
    (bytes / each).max(copies)
}

impl Walk<'_> {
    fn roots(&self) -> Result<Vec<usize>, MeshReadError> {
        let root = self.root;
        let scene = root.scene.map_or(0, |scene| scene.value());
        match root.scenes.get(scene) {
            Some(scene)
                if !scene.nodes.is_empty() || root.scenes.iter().any(|other| !other.nodes.is_empty()) =>
            {
                Ok(scene.nodes.iter().map(|node| node.value()).collect())
            }
            None if root.scene.is_some() && !root.scenes.is_empty() => Err(MeshReadError::BrokenReference {
                item: "the file".into(),
                kind: "scene",
                index: scene,
                count: root.scenes.len(),
            }),
            // A file without scenes, or with empty ones, is a library of nodes; all nodes without a parent are roots.
            _ => {
                let mut is_child = vec![false; root.nodes.len()];
                for child in root.nodes.iter().flat_map(children) {
                    if let Some(seen) = is_child.get_mut(child) {
                        *seen = true;
                    }
                }
                Ok((0..root.nodes.len()).filter(|&node| !is_child[node]).collect())
            }
        }
    }

    /// The quarter turn about X that all roots with a mesh or children have in common.
    fn turn_of(&self, roots: &[usize]) -> RootTurn {
        let turns: Vec<RootTurn> =
            self.carriers(roots).map(|(_, transform)| quarter_turn(&transform)).collect();
        match turns.first() {
            Some(&first) if turns.iter().all(|&turn| turn == first) => first,
            _ => RootTurn::Other,
        }
    }

    /// The pose of the first node that moves or turns the whole part: a root, or below roots that do not.
    fn root_pose(&self, roots: &[usize]) -> Option<RootPose> {
        let mut level = roots.to_vec();
        // As many levels as nodes at most, also where nodes are their own children.
        for _ in &self.root.nodes {
            let carriers: Vec<(&Node, Transform)> = self.carriers(&level).collect();
            let [(node, transform)] = &carriers[..] else { return None };
            let matrix = matrix_of(transform);
            if !matrix.is_identity(f64::EPSILON) {
                return RootPose::of(&matrix);
            }
            if node.mesh.is_some() {
                return None;
            }
            let below = children(node).collect();
            level = below;
        }
        None
    }

    /// Those of the nodes that have a mesh or children, with their transforms.
    fn carriers<'a>(&'a self, nodes: &'a [usize]) -> impl Iterator<Item = (&'a Node, Transform)> {
        nodes
            .iter()
            .filter_map(|&number| self.root.nodes.get(number).zip(self.transform(number)))
            .filter(|(node, _)| node.mesh.is_some() || node.children.is_some())
    }

    /// A node's own transform.
    fn transform(&self, number: usize) -> Option<Transform> {
        self.data.document.nodes().nth(number).map(|node| node.transform())
    }

    fn nodes(&mut self, roots: Vec<usize>) -> Result<(), MeshReadError> {
        let nodes = &self.root.nodes;
        let mut transforms: Vec<Option<Matrix4<f64>>> = vec![None; nodes.len()];
        let mut reached = Vec::new();
        let mut waiting: Vec<(usize, Matrix4<f64>, bool)> =
            roots.into_iter().rev().map(|node| (node, Matrix4::identity(), false)).collect();
        while let Some((number, above, is_hidden)) = waiting.pop() {
            let node = nodes.get(number).zip(self.transform(number));
            let (node, own_transform) = node.ok_or_else(|| MeshReadError::BrokenReference {
                item: "the node tree".into(),
                kind: "node",
                index: number,
                count: nodes.len(),
            })?;
            let transform = above * matrix_of(&own_transform);
            // In a tree every node is reached once; this also ends the walk on cycles.
            if transforms[number].replace(transform).is_some() {
                return Err(MeshReadError::NodeTwice { node: node_name(node, number) });
            }
            if !transform.iter().all(|entry| entry.is_finite()) {
                return Err(MeshReadError::BadTransform { node: node_name(node, number) });
            }
            let is_hidden = is_hidden || hides(node);
            reached.push((number, transform, is_hidden));
            let children = children(node).collect::<Vec<_>>().into_iter().rev();
            waiting.extend(children.map(|child| (child, transform, is_hidden)));
        }
        // Joints of a skin can be anywhere in the tree.
        let mut hidden = 0;
        for (number, transform, is_hidden) in reached {
            hidden += usize::from(is_hidden && nodes[number].mesh.is_some());
            self.node(&nodes[number], number, &transform, &transforms, is_hidden)?;
        }
        self.skip("hidden object", hidden);
        self.part.notices.extend(hidden_notice(hidden));
        let unreached =
            nodes.iter().zip(&transforms).filter(|(node, reached)| node.mesh.is_some() && reached.is_none());
        self.skip("object outside the default scene", unreached.count());
        Ok(())
    }

    fn node(
        &mut self,
        node: &Node,
        number: usize,
        transform: &Matrix4<f64>,
        transforms: &[Option<Matrix4<f64>>],
        is_hidden: bool,
    ) -> Result<(), MeshReadError> {
        self.skip("camera", usize::from(node.camera.is_some()));
        if let Some(extensions) = &node.extensions {
            self.skip("light", usize::from(extensions.others.contains_key("KHR_lights_punctual")));
        }
        if is_frame(node) {
            let is_exact = node.name.as_deref() == Some(FRAME);
            self.part.frames.push(FrameNode { is_exact, transform: *transform });
        }
        let Some(mesh_index) = node.mesh.filter(|_| !is_hidden) else { return Ok(()) };
        let meshes = &self.root.meshes;
        let mesh = meshes.get(mesh_index.value()).ok_or_else(|| MeshReadError::BrokenReference {
            item: node_name(node, number),
            kind: "mesh",
            index: mesh_index.value(),
            count: meshes.len(),
        })?;
        let mesh_name = name_of_mesh(mesh, mesh_index);
        let before = self.part.triangles.len();
        let is_mark = [node.name.as_deref(), mesh.name.as_deref()].into_iter().flatten().any(bounds_ink);
        let pose = self.pose(node, number, transform, transforms)?;
        let weights = node.weights.as_deref().or(mesh.weights.as_deref()).unwrap_or_default();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            self.primitive(primitive, &mesh_name, number, weights, &pose)?;
            self.bound_ink(is_mark || self.is_mark_material(primitive));
        }
        if self.part.triangles.len() > before {
            self.part.bodies.push(node.name.clone().unwrap_or(mesh_name));
        }
        Ok(())
    }

    /// How the vertices of a node's mesh get to their places.
    fn pose(
        &mut self,
        node: &Node,
        number: usize,
        transform: &Matrix4<f64>,
        transforms: &[Option<Matrix4<f64>>],
    ) -> Result<Pose, MeshReadError> {
        if let Some(index) = node.skin {
            let skins = &self.root.skins;
            let skin = skins.get(index.value()).ok_or_else(|| MeshReadError::BrokenReference {
                item: node_name(node, number),
                kind: "skin",
                index: index.value(),
                count: skins.len(),
            })?;
            // The joints alone place the mesh; its node's own transform has no effect.
            return pose::joints(&self.data, skin, index.value(), transforms, &mut self.moved)
                .map(Pose::Joints);
        }
        let item = |what: &str| format!("{}, {what}", node_name(node, number));
        let instances = pose::instances(&self.data, node, &item)?.unwrap_or(vec![Matrix4::identity()]);
        self.instances += instances.len();
        at_most("instances", self.instances, MAX_INSTANCES)?;
        let copies: Vec<Matrix4<f64>> = instances.iter().map(|instance| transform * instance).collect();
        match copies.iter().flatten().all(|entry| entry.is_finite()) {
            true => Ok(Pose::Copies(copies)),
            false => Err(MeshReadError::BadTransform { node: item("an instance") }),
        }
    }

    fn is_mark_material(&self, primitive: &Primitive) -> bool {
        let material = primitive.material.and_then(|index| self.root.materials.get(index.value()));
        material.and_then(|material| material.name.as_deref()).is_some_and(bounds_ink)
    }

    /// Notes for the triangles added last whether they are faces named `mark`.
    fn bound_ink(&mut self, is_mark: bool) {
        if is_mark || !self.part.is_mark.is_empty() {
            // Those before the first one of this name are not.
            self.part.is_mark.resize(self.noted_triangles, false);
            self.part.is_mark.resize(self.part.triangles.len(), is_mark);
        }
        self.noted_triangles = self.part.triangles.len();
    }

    fn primitive(
        &mut self,
        primitive: &Primitive,
        mesh: &str,
        number: usize,
        weights: &[f32],
        pose: &Pose,
    ) -> Result<(), MeshReadError> {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let item = |what: &str| format!("mesh \"{mesh}\", primitive {number}, {what}");
        if let Some(what) = no_surface(primitive) {
            self.skip(what, 1);
            return Ok(());
        }
        let Some(positions) = attribute(Semantic::Positions) else {
            self.skip("primitive without positions", 1);
            return Ok(());
        };

        let decoded = self.decoded(primitive, &|| item("Draco data"))?;
        let is_moved = matches!(pose, Pose::Joints(_)) || weights.iter().any(|weight| *weight != 0.0);
        if decoded.is_some() && is_moved && (primitive.targets.is_some() || matches!(pose, Pose::Joints(_))) {
            // The order of the vertices is not that of the other data.
            let problem =
                "they have a skin or morph targets, which are not read together with compression".into();
            return Err(MeshReadError::Compressed { item: item("Draco data"), problem });
        }
        let (mut positions, mut normals, indices) = match decoded {
            Some(Decoded { positions, normals, indices }) => (positions, normals, Some(indices)),
            None => {
                let normals = attribute(Semantic::Normals);
                let positions = self.data.vectors(positions, &|| item("POSITION"))?;
                let normals =
                    normals.map(|normals| self.data.vectors(normals, &|| item("NORMAL"))).transpose()?;
                (positions, normals, None)
            }
        };
        let is_morphed = pose::morph(
            &self.data,
            primitive,
            weights,
            &mut positions,
            &mut normals,
            &mut self.moved,
            &item,
        )?;
        self.skip("set of morph targets", usize::from(primitive.targets.is_some() && !is_morphed));
        let place = |vertex| VertexPlace::Gltf { mesh: mesh.into(), primitive: number, vertex };
        for (vertex, position) in positions.iter().enumerate() {
            if !position.iter().all(|coordinate| coordinate.is_finite()) {
                let coordinate = position.map(f64::from);
                return Err(MeshReadError::NotFinite { vertex: place(vertex), coordinate });
            }
        }

        // Draco data are a list of triangles, whichever mode the primitive has.
        let mode = if indices.is_some() { Checked::Valid(Mode::Triangles) } else { primitive.mode };
        let sequence = match (indices, primitive.indices) {
            (Some(indices), _) => indices,
            (None, Some(indices)) => self.data.indices(indices, &|| item("indices"))?,
            (None, None) => (0..positions.len() as u32).collect(),
        };
        let highest = sequence.iter().enumerate().max_by_key(|(_, index)| **index);
        if let Some((corner, &index)) = highest.filter(|(_, index)| **index as usize >= positions.len()) {
            return Err(MeshReadError::IndexOutOfRange {
                face: place(corner),
                kind: "vertex",
                index: i64::from(index),
                count: positions.len(),
            });
        }
        let shape = Decoded { positions, normals, indices: sequence };
        match pose {
            Pose::Copies(copies) => {
                for copy in copies {
                    let (linear, shift) = parts(copy);
                    // A transform that flattens the object leaves no normals; they are estimated later.
                    let turn = linear.try_inverse().map(|inverse| inverse.transpose());
                    self.place(&shape, mode, linear.determinant() < 0.0, &|_| (linear, shift), &|_| turn)?;
                }
            }
            Pose::Joints(joints) => {
                let vertices = shape.positions.len();
                let influences = Influences::of(&self.data, primitive, vertices, joints.len(), &item)?;
                let at = |vertex: usize| parts(&influences.matrix(vertex, joints));
                let turn = |vertex: usize| at(vertex).0.try_inverse().map(|inverse| inverse.transpose());
                let mirrored = (0..vertices).filter(|vertex| at(*vertex).0.determinant() < 0.0).count();
                self.place(&shape, mode, 2 * mirrored > vertices, &at, &turn)?;
            }
        }
        if matches!(mode, Checked::Valid(Mode::Triangles)) && !shape.indices.len().is_multiple_of(3) {
            self.skip("triangle without a third corner", 1);
        }
        self.note_material(primitive);
        Ok(())
    }

    /// Adds a shape; `at` moves each of its vertices, and `turn` its normal.
    fn place(
        &mut self,
        shape: &Decoded,
        mode: Checked<Mode>,
        is_mirrored: bool,
        at: &dyn Fn(usize) -> (Matrix3<f64>, Vector3<f64>),
        turn: &dyn Fn(usize) -> Option<Matrix3<f64>>,
    ) -> Result<(), MeshReadError> {
        let first_vertex = self.part.positions.len();
        // Vertices of all instances are numbered consecutively, and every index must fit.
        let vertices = first_vertex + shape.positions.len();
        at_most("vertices", vertices, self.max_vertices)?;
        check_pace(self.pace, vertices, 3 * QUICK_TRIANGLES)?;
        let is_list = matches!(mode, Checked::Valid(Mode::Triangles));
        let wanted = self.part.triangles.len() + shape.indices.len() / if is_list { 3 } else { 1 };
        at_most("triangles", wanted, self.max_triangles)?;
        check_pace(self.pace, wanted, QUICK_TRIANGLES)?;
        for (vertex, position) in shape.positions.iter().enumerate() {
            let (linear, shift) = at(vertex);
            self.part.positions.push(Point3::from(linear * Vector3::from(position.map(f64::from)) + shift));
        }
        self.normals(shape.normals.as_deref(), turn, shape.positions.len());
        let first = first_vertex as u32;
        expand(mode, &shape.indices, |[a, b, c]| {
            let corners = if is_mirrored { [a, c, b] } else { [a, b, c] };
            self.part.triangles.push(corners.map(|index| first + index));
        });
        Ok(())
    }

    /// The geometry of a primitive whose data are compressed.
    fn decoded(
        &self,
        primitive: &Primitive,
        item: &dyn Fn() -> String,
    ) -> Result<Option<Decoded>, MeshReadError> {
        let extensions = primitive.extensions.as_ref();
        let Some(extension) = extensions.and_then(|extensions| extensions.others.get(draco::NAME)) else {
            return Ok(None);
        };
        let view = extension["bufferView"].as_u64().and_then(|view| u32::try_from(view).ok());
        let view = view.ok_or_else(|| MeshReadError::NoData { item: item() })?;
        draco::decode(self.data.view(Index::new(view), item)?, extension, item).map(Some)
    }

    /// Adds a shape's normals, turned by `turn`, or as many zero vectors if it has none.
    fn normals(
        &mut self,
        normals: Option<&[[f32; 3]]>,
        turn: &dyn Fn(usize) -> Option<Matrix3<f64>>,
        vertices: usize,
    ) {
        let wanted = self.part.normals.len() + vertices;
        if let Some(normals) = normals {
            if self.part.clues.is_open_cascade() {
                normals.iter().for_each(|&normal| self.part.clues.zeros.count(normal));
            }
            let turned = normals.iter().take(vertices).enumerate().map(|(vertex, normal)| {
                turn(vertex).map_or(Vector3::zeros(), |turn| turn * Vector3::from(normal.map(f64::from)))
            });
            self.part.normals.extend(turned);
            self.has_normals = true;
        }
        self.part.normals.resize(wanted, Vector3::zeros());
    }

    fn note_material(&mut self, primitive: &Primitive) {
        let Some(material) = primitive.material else { return };
        let number = material.value();
        if self.used_materials.get(number) == Some(&false) {
            self.used_materials[number] = true;
            let name = self.root.materials[number].name.clone();
            self.part.materials.push(name.unwrap_or_else(|| format!("material {number}")));
        }
    }

    fn skip(&mut self, what: &'static str, count: usize) {
        if count > 0 {
            *self.skipped.entry(what).or_default() += count;
        }
    }

    fn finish_skipped(&mut self) {
        self.skip("animation", self.root.animations.len());
        self.part.skipped = self.skipped.iter().map(|(what, count)| format!("{count} x {what}")).collect();
    }

    fn finish(self) -> Result<RawPart, MeshReadError> {
        let mut part = self.part;
        if part.triangles.is_empty() {
            let root = self.root;
            let cause = match () {
                _ if !self.skipped.is_empty() => EmptyCause::OnlyOthers(part.skipped),
                _ if root.meshes.is_empty() && !root.nodes.is_empty() && part.clues.is_open_cascade() => {
                    EmptyCause::NeverMeshed
                }
                _ => EmptyCause::Nothing,
            };
            return Err(MeshReadError::NoTriangles { cause });
        }
        if !self.has_normals {
            part.normals.clear();
            part.normals_found = NormalsFound::None;
            return Ok(part);
        }
        let normal = |triangle: usize, corner: usize| {
            let index: u32 = part.triangles[triangle][corner];
            part.normals[index as usize]
        };
        part.normals_found = NormalsFound::Smooth;
        if let Some(welded) = normals::weld_facets(&part.positions, &part.triangles, normal) {
            part.normals_found = NormalsFound::FacetsOnly;
            part.normals.clear();
            (part.positions, part.triangles) = welded;
        }
        Ok(part)
    }
}

/// Whether the node is a marking frame: an empty of its name, also with the number that Blender adds to the name of a copy
/// (`isomark.001`).
pub(super) fn is_frame(node: &Node) -> bool {
    node.mesh.is_none() && node.name.as_deref().is_some_and(|name| is_nearly(name, FRAME))
}

/// Whether the node hides itself and everything below it.
fn hides(node: &Node) -> bool {
    let extension = node.extensions.as_ref().and_then(|extensions| extensions.others.get(VISIBILITY));
    extension.is_some_and(|extension| extension["visible"] == false)
}

/// The linear part of an affine transform, and its shift.
fn parts(transform: &Matrix4<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    (transform.fixed_view::<3, 3>(0, 0).into_owned(), transform.fixed_view::<3, 1>(0, 3).into_owned())
}

/// What the primitive is, unless it is a surface.
fn no_surface(primitive: &Primitive) -> Option<&'static str> {
    match primitive.mode {
        Checked::Valid(Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) => None,
        Checked::Valid(Mode::Points) => Some("set of points"),
        Checked::Valid(Mode::Lines | Mode::LineLoop | Mode::LineStrip) => Some("set of lines"),
        Checked::Invalid => Some("primitive of an unknown kind"),
    }
}

/// The triangles of a list, strip or fan, all with the same orientation.
fn expand(mode: Checked<Mode>, sequence: &[u32], mut push: impl FnMut([u32; 3])) {
    match mode {
        Checked::Valid(Mode::TriangleStrip) => {
            // Every other triangle of a strip has the opposite orientation.
            let turned = |(at, run): (usize, &[u32])| {
                if at % 2 == 0 { [run[0], run[1], run[2]] } else { [run[1], run[0], run[2]] }
            };
            sequence.windows(3).enumerate().map(turned).for_each(push);
        }
        Checked::Valid(Mode::TriangleFan) => {
            let hub = sequence.first().copied().unwrap_or(0);
            sequence.windows(2).skip(1).for_each(|rim| push([hub, rim[0], rim[1]]));
        }
        _ => sequence.chunks_exact(3).for_each(|run| push([run[0], run[1], run[2]])),
    }
}

fn children(node: &Node) -> impl Iterator<Item = usize> + '_ {
    node.children.iter().flatten().map(|child| child.value())
}

fn node_name(node: &Node, number: usize) -> String {
    node.name.as_ref().map_or_else(|| format!("node {number}"), |name| format!("node \"{name}\""))
}

fn name_of_mesh(mesh: &Mesh, index: Index<Mesh>) -> String {
    mesh.name.clone().unwrap_or_else(|| format!("mesh {}", index.value()))
}

/// A transform as a matrix. It is composed in f64, because f32 products lose 1e-4 mm at the end of a long tree.
fn matrix_of(transform: &Transform) -> Matrix4<f64> {
    match transform {
        Transform::Matrix { matrix } => Matrix4::from(matrix.map(|column| column.map(f64::from))),
        Transform::Decomposed { translation, rotation, scale } => composed(*translation, *rotation, *scale),
    }
}

/// The quarter turn about X, to within 1e-5 rad, of a transform without scale.
fn quarter_turn(transform: &Transform) -> RootTurn {
    let Transform::Decomposed { rotation, scale, .. } = transform else { return RootTurn::Other };
    if scale.iter().any(|factor| (factor - 1.0).abs() > 1e-5) {
        return RootTurn::Other;
    }
    let turn = unit(*rotation).map_or(Vector3::zeros(), |turn| turn.scaled_axis());
    let quarter = Vector3::x() * std::f64::consts::FRAC_PI_2;
    if (turn - quarter).norm() < 1e-5 {
        RootTurn::UpToFront
    } else if (turn + quarter).norm() < 1e-5 {
        RootTurn::FrontToUp
    } else {
        RootTurn::Other
    }
}
