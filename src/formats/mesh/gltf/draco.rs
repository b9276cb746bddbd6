//! Decodes primitives that are compressed with `KHR_draco_mesh_compression` (Khronos, 2018).

use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute};
use serde_json::Value;

use crate::formats::mesh::{MAX_TRIANGLES, MeshReadError};

/// The name of the extension.
pub(super) const NAME: &str = "KHR_draco_mesh_compression";
/// Largest memory for the attributes of one primitive, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// The geometry of a primitive.
pub(super) struct Decoded {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) normals: Option<Vec<[f32; 3]>>,
    /// Three indices for each triangle.
    pub(super) indices: Vec<u32>,
}

/// Decodes the data of a primitive, whose extension gives the number of each attribute; `item` names it for messages.
pub(super) fn decode(
    data: &[u8],
    extension: &Value,
    item: &dyn Fn() -> String,
) -> Result<Decoded, MeshReadError> {
    let problem = |problem: String| MeshReadError::Compressed { item: item(), problem };
    let limits = DecodeLimits::default()
        .with_max_points(3 * MAX_TRIANGLES as u64)
        .with_max_faces(MAX_TRIANGLES as u64)
        .with_max_decoded_bytes(MAX_BYTES);
    let mut mesh = Mesh::new();
    let mut buffer = DecoderBuffer::new(data).with_limits(limits);
    MeshDecoder::new().decode(&mut buffer, &mut mesh).map_err(|error| problem(error.to_string()))?;
    let number =
        |name: &str| extension["attributes"][name].as_u64().and_then(|number| u32::try_from(number).ok());
    let attribute = |name: &str| number(name).and_then(|number| mesh.attribute_by_unique_id(number));
    let triples = |attribute: &PointAttribute| -> Option<Vec<[f32; 3]>> {
        (attribute.num_components() == 3)
            .then(|| attribute.read_f32s(mesh.num_points(), 3).as_chunks().0.to_vec())
    };
    let positions = attribute("POSITION").and_then(triples);
    Ok(Decoded {
        positions: positions.ok_or_else(|| problem("they contain no positions".into()))?,
        normals: attribute("NORMAL").and_then(triples),
        indices: mesh.faces().iter().flatten().map(|point| point.0).collect(),
    })
}
