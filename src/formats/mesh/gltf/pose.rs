//! Where the vertices of a mesh are: morph targets move them, then the node's transform, those of its instances, or the joints of a
//! skin (Khronos, glTF 2.0 specification, 3.7; `EXT_mesh_gpu_instancing`).

use ::gltf::json::mesh::{Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Index, Node, Skin, accessor::Accessor};
use nalgebra::{Matrix3, Matrix4, Quaternion, UnitQuaternion, Vector3};

use crate::formats::mesh::{MeshReadError, at_most};

use super::accessor::Data;

/// The extension that repeats a mesh.
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";
/// Largest number of vertices that morph targets move in a file, each counted once for each target and object, and of joints, each counted
/// once for each object.
const MAX_MOVED: usize = 50_000_000;
/// Largest number of sets of joints of a vertex, four each.
const MAX_SETS: u32 = 8;

/// How the vertices of an object get to their places.
pub(super) enum Pose {
    /// The mesh is there once for each transform.
    Copies(Vec<Matrix4<f64>>),
    /// The mesh is moved by the joints of a skin, which have these matrices.
    Joints(Vec<Matrix4<f64>>),
}

/// The transforms of a node's instances, as seen from the node; `None` without the extension.
pub(super) fn instances(
    data: &Data<'_>,
    node: &Node,
    item: &dyn Fn(&str) -> String,
) -> Result<Option<Vec<Matrix4<f64>>>, MeshReadError> {
    let extensions = node.extensions.as_ref();
    let Some(extension) = extensions.and_then(|extensions| extensions.others.get(INSTANCING)) else {
        return Ok(None);
    };
    let accessor = |name: &str| -> Option<Index<Accessor>> {
        let number = extension["attributes"][name].as_u64()?;
        Some(Index::new(u32::try_from(number).unwrap_or(u32::MAX)))
    };
    let vectors = |name: &str| {
        accessor(name).map(|index| data.vectors(index, &|| item(&format!("{name} of instances")))).transpose()
    };
    let (shifts, scales) = (vectors("TRANSLATION")?, vectors("SCALE")?);
    let turns = accessor("ROTATION")
        .map(|index| data.quadruples(index, &|| item("ROTATION of instances")))
        .transpose()?;
    let counts = [shifts.as_ref().map(Vec::len), turns.as_ref().map(Vec::len), scales.as_ref().map(Vec::len)];
    let Some(count) = counts.into_iter().flatten().next() else { return Ok(None) };
    for other in counts.into_iter().flatten() {
        same_count(other, count, &|| item("the transforms of instances"))?;
    }
    let transform = |at: usize| {
        let shift = shifts.as_ref().map_or([0.0; 3], |shifts| shifts[at]);
        let turn = turns.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |turns| turns[at]);
        let scale = scales.as_ref().map_or([1.0; 3], |scales| scales[at]);
        composed(shift, turn, scale)
    };
    Ok(Some((0..count).map(transform).collect()))
}

/// A translation after a rotation after a scale, as a matrix.
pub(super) fn composed(translation: [f32; 3], rotation: [f32; 4], scale: [f32; 3]) -> Matrix4<f64> {
    let scale = Matrix3::from_diagonal(&Vector3::from(scale.map(f64::from)));
    let turn = unit(rotation).map_or(Matrix3::identity(), |turn| turn.to_rotation_matrix().into_inner());
    (turn * scale).to_homogeneous().append_translation(&Vector3::from(translation.map(f64::from)))
}

/// The quaternion, rounded to seven digits in the file, with exact unit length again; `None` for length zero.
pub(super) fn unit(quaternion: [f32; 4]) -> Option<UnitQuaternion<f64>> {
    let [x, y, z, w] = quaternion.map(f64::from);
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6)
}

/// The matrices of a skin's joints, from the transforms of all nodes of the scene.
pub(super) fn joints(
    data: &Data<'_>,
    skin: &Skin,
    number: usize,
    transforms: &[Option<Matrix4<f64>>],
    moved: &mut usize,
) -> Result<Vec<Matrix4<f64>>, MeshReadError> {
    *moved += skin.joints.len();
    at_most("vertices of morph targets and joints", *moved, MAX_MOVED)?;
    if skin.joints.is_empty() {
        return Err(MeshReadError::NoData { item: format!("skin {number}, joints") });
    }
    let inverses = skin
        .inverse_bind_matrices
        .map(|index| data.matrices(index, &|| format!("skin {number}, inverseBindMatrices")))
        .transpose()?;
    let matrix = |(at, joint): (usize, &Index<Node>)| {
        let name = || format!("joint {at} of skin {number}, node {}", joint.value());
        let transform =
            transforms.get(joint.value()).copied().flatten().ok_or_else(|| MeshReadError::WrongData {
                item: name(),
                expected: "a node of the default scene",
                found: "a node outside it".into(),
            })?;
        let inverse = match &inverses {
            Some(inverses) => {
                let inverse = inverses.get(at).ok_or_else(|| MeshReadError::WrongData {
                    item: format!("skin {number}, inverseBindMatrices"),
                    expected: "a matrix for each joint",
                    found: format!("{} matrices for {} joints", inverses.len(), skin.joints.len()),
                })?;
                Matrix4::from(inverse.map(|column| column.map(f64::from)))
            }
            None => Matrix4::identity(),
        };
        let matrix = transform * inverse;
        match matrix.iter().all(|entry| entry.is_finite()) {
            true => Ok(matrix),
            false => Err(MeshReadError::BadTransform { node: name() }),
        }
    };
    skin.joints.iter().enumerate().map(matrix).collect()
}

/// By which joints each vertex of a primitive is moved, and how much.
pub(super) struct Influences {
    sets: Vec<InfluenceSet>,
}

/// Four joints of each vertex, and their weights.
struct InfluenceSet {
    numbers: Vec<[u16; 4]>,
    weights: Vec<[f32; 4]>,
}

impl Influences {
    pub(super) fn of(
        data: &Data<'_>,
        primitive: &Primitive,
        vertices: usize,
        joints: usize,
        item: &dyn Fn(&str) -> String,
    ) -> Result<Self, MeshReadError> {
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let mut sets = Vec::new();
        for set in 0..MAX_SETS {
            let (Some(numbers), Some(weights)) =
                (attribute(Semantic::Joints(set)), attribute(Semantic::Weights(set)))
            else {
                break;
            };
            let numbers = data.joints(numbers, &|| item(&format!("JOINTS_{set}")))?;
            let weights = data.quadruples(weights, &|| item(&format!("WEIGHTS_{set}")))?;
            same_count(numbers.len(), vertices, &|| item(&format!("JOINTS_{set}")))?;
            same_count(weights.len(), vertices, &|| item(&format!("WEIGHTS_{set}")))?;
            let pairs = numbers.iter().flatten().zip(weights.iter().flatten());
            let beyond = |(number, weight): &(&u16, &f32)| **weight != 0.0 && usize::from(**number) >= joints;
            if let Some((&number, _)) = pairs.clone().find(beyond) {
                return Err(MeshReadError::BrokenReference {
                    item: item(&format!("JOINTS_{set}")),
                    kind: "joint",
                    index: usize::from(number),
                    count: joints,
                });
            }
            sets.push(InfluenceSet { numbers, weights });
        }
        match sets.is_empty() {
            true => Err(MeshReadError::NoData { item: item("JOINTS_0 and WEIGHTS_0") }),
            false => Ok(Self { sets }),
        }
    }

    /// The matrix that moves a vertex: the mean of its joints' matrices by their weights; that of the first joint without weights.
    pub(super) fn matrix(&self, vertex: usize, joints: &[Matrix4<f64>]) -> Matrix4<f64> {
        let (mut sum, mut matrix) = (0.0, Matrix4::zeros());
        for InfluenceSet { numbers, weights } in &self.sets {
            for (number, weight) in numbers[vertex].into_iter().zip(weights[vertex]) {
                let joint = joints.get(usize::from(number)).filter(|_| weight != 0.0);
                if let Some(joint) = joint {
                    matrix += joint * f64::from(weight);
                    sum += f64::from(weight);
                }
            }
        }
        let first = || joints.first().copied().unwrap_or_else(Matrix4::identity);
        if sum.is_finite() && sum > 1e-6 { matrix / sum } else { first() }
    }
}

/// Moves positions and normals by the morph targets whose weights are not zero; returns whether there are any. The vertices are added to
/// those that were `moved` so far.
///
/// A target that moves positions without normals leaves none, as they would be those of the other shape.
pub(super) fn morph(
    data: &Data<'_>,
    primitive: &Primitive,
    weights: &[f32],
    positions: &mut [[f32; 3]],
    normals: &mut Option<Vec<[f32; 3]>>,
    moved: &mut usize,
    item: &dyn Fn(&str) -> String,
) -> Result<bool, MeshReadError> {
    let before = *moved;
    let targets = primitive.targets.iter().flatten().enumerate().zip(weights);
    for ((number, target), &weight) in targets.filter(|(_, weight)| **weight != 0.0) {
        *moved += positions.len();
        at_most("vertices of morph targets and joints", *moved, MAX_MOVED)?;
        let differences = |index: Index<Accessor>, name: &str, count: usize| {
            let item = || item(&format!("{name} of morph target {number}"));
            // A target that moves nothing needs no data.
            if let Some(zeros) = data.zeros(index, &item)? {
                return same_count(zeros as usize, count, &item).map(|()| None);
            }
            let differences = data.vectors(index, &item)?;
            same_count(differences.len(), count, &item).map(|()| Some(differences))
        };
        if let Some(index) = target.positions {
            let moves = differences(index, "POSITION", positions.len())?;
            if let Some(moves) = moves {
                add(positions, &moves, weight);
                if target.normals.is_none() {
                    *normals = None;
                }
            }
        }
        if let (Some(index), Some(normals)) = (target.normals, normals.as_mut())
            && let Some(moves) = differences(index, "NORMAL", normals.len())?
        {
            add(normals, &moves, weight);
        }
    }
    Ok(*moved > before)
}

fn add(values: &mut [[f32; 3]], moves: &[[f32; 3]], weight: f32) {
    for (value, by) in values.iter_mut().flatten().zip(moves.iter().flatten()) {
        *value += weight * by;
    }
}

fn same_count(count: usize, expected: usize, item: &dyn Fn() -> String) -> Result<(), MeshReadError> {
    match count == expected {
        true => Ok(()),
        false => Err(MeshReadError::WrongData {
            item: item(),
            expected: "as many elements as those beside them",
            found: format!("{count} elements beside {expected}"),
        }),
    }
}
