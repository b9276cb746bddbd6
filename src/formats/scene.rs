//! Writes pictures in three dimensions as glTF 2.0 binary files (Khronos, glTF 2.0 specification, 2021).
//!
//! Values are in mm with +Z up, as everywhere in isomark; the file is in metres with +Y up, as glTF requires, so a part that
//! was read from a glTF keeps its place.

use std::sync::LazyLock;

use serde_json::{Value, json};

/// A scene: a root node and its children.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The name of the root node.
    pub name: String,
    /// Data for programs, in the root node's `extras`.
    pub extras: Value,
    /// The children; those without primitives are omitted.
    pub nodes: Vec<Node>,
}

/// A node with a mesh of the same name.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// Its name.
    pub name: String,
    /// What it is made of.
    pub material: Material,
    /// What it shows.
    pub primitives: Vec<Primitive>,
}

/// How a node looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Its colour, sRGB.
    pub color: [u8; 3],
    /// Whether light and shade change the colour.
    pub is_lit: bool,
}

/// Triangles or lines, mm with +Z up.
#[derive(Debug, Clone, PartialEq)]
pub enum Primitive {
    /// Triangles, seen from both sides; one normal for each vertex, or none.
    Triangles {
        /// The vertices, mm.
        positions: Vec<[f32; 3]>,
        /// Unit normals.
        normals: Vec<[f32; 3]>,
        /// Three vertices each.
        triangles: Vec<[u32; 3]>,
    },
    /// A line from point to point.
    Strip {
        /// The points, mm.
        positions: Vec<[f32; 3]>,
        /// The colour of each point, sRGB; none for the colour of the material.
        colors: Vec<[u8; 3]>,
    },
    /// Separate lines, in pairs of points.
    Lines {
        /// The points, mm.
        positions: Vec<[f32; 3]>,
        /// The colour of each point, sRGB; none for the colour of the material.
        colors: Vec<[u8; 3]>,
        /// Two points each.
        lines: Vec<[u32; 2]>,
    },
}

const HEADER: usize = 12;
const CHUNK_HEADER: usize = 8;
const UNLIT: &str = "KHR_materials_unlit";

// Numbers of the specification.
const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
const LINES: u32 = 1;
const LINE_STRIP: u32 = 3;
const TRIANGLES: u32 = 4;

/// The bytes of a scene as GLB; the same scene gives the same bytes. Primitives without lines or triangles are omitted.
#[must_use]
pub fn write(scene: &Scene, generator: &str) -> Vec<u8> {
    let mut data = Data::default();
    let (mut nodes, mut meshes, mut materials) = (Vec::new(), Vec::new(), Vec::new());
    for node in &scene.nodes {
        let primitives =
            node.primitives.iter().filter_map(|primitive| data.primitive(primitive, materials.len()));
        let primitives: Vec<Value> = primitives.collect();
        if primitives.is_empty() {
            continue;
        }
        nodes.push(json!({ "name": node.name, "mesh": meshes.len() }));
        meshes.push(json!({ "name": node.name, "primitives": primitives }));
        materials.push(material(node));
    }
    let mut root = json!({ "name": scene.name, "extras": scene.extras });
    if !nodes.is_empty() {
        root["children"] = (0..nodes.len()).collect();
    }
    let root_number = nodes.len();
    nodes.push(root);
    let mut document = json!({
        "asset": { "version": "2.0", "generator": generator },
        "scene": 0,
        "scenes": [{ "nodes": [root_number] }],
        "nodes": nodes,
    });
    let mut buffer = Vec::new();
    if !meshes.is_empty() {
        if materials.iter().any(|material| material.get("extensions").is_some()) {
            document["extensionsUsed"] = json!([UNLIT]);
        }
        let (views, accessors) = data.laid_out(&mut buffer);
        document["meshes"] = meshes.into();
        document["materials"] = materials.into();
        document["accessors"] = accessors.into();
        document["bufferViews"] = views.into();
        document["buffers"] = json!([{ "byteLength": buffer.len() }]);
    }
    container(&document, &buffer)
}

fn container(document: &Value, buffer: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let padded = buffer.len().next_multiple_of(4);
    let binary = if buffer.is_empty() { 0 } else { CHUNK_HEADER + padded };
    let mut file = Vec::with_capacity(HEADER + CHUNK_HEADER + json.len() + binary);
    let number = |file: &mut Vec<u8>, value: usize| file.extend_from_slice(&(value as u32).to_le_bytes());
    file.extend_from_slice(b"glTF");
    number(&mut file, 2);
    number(&mut file, HEADER + CHUNK_HEADER + json.len() + binary);
    number(&mut file, json.len());
    file.extend_from_slice(b"JSON");
    file.extend_from_slice(&json);
    if !buffer.is_empty() {
        number(&mut file, padded);
        file.extend_from_slice(b"BIN\0");
        file.extend_from_slice(buffer);
        file.resize(file.len() + padded - buffer.len(), 0);
    }
    file
}

fn material(node: &Node) -> Value {
    let [red, green, blue] = node.material.color.map(linear);
    let mut material = json!({
        "name": node.name,
        "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorFactor": [red, green, blue, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        },
    });
    if !node.material.is_lit {
        material["extensions"] = json!({ UNLIT: {} });
    }
    material
}

/// A channel of sRGB as linear light, 0 to 1 (IEC 61966-2-1).
fn linear(channel: u8) -> f64 {
    let value = f64::from(channel) / 255.0;
    let light = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    (light * 1e5).round() / 1e5
}

/// The light of each channel of sRGB; 65,535 is full light.
static LIGHT: LazyLock<[u16; 256]> = LazyLock::new(|| {
    std::array::from_fn(|channel| (linear(channel as u8) * f64::from(u16::MAX)).round() as u16)
});

/// A vector of isomark with the axes of glTF.
fn turned([x, y, z]: [f32; 3]) -> [f32; 3] {
    // Adding 0 turns -0 into 0.
    [x + 0.0, z + 0.0, -y + 0.0]
}

/// A point of isomark, mm, as a point of glTF, m.
fn placed(point: [f32; 3]) -> [f32; 3] {
    let metres = |value: f32| (f64::from(value) / 1000.0) as f32;
    let [x, y, z] = turned(point);
    [metres(x), metres(y), metres(z)]
}

/// A part of the buffer in which all data have the same layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Block {
    Vectors,
    Colors,
    LongIndices,
    /// The last one: it may end at an odd number of indices.
    ShortIndices,
}

const BLOCKS: [Block; 4] = [Block::Vectors, Block::Colors, Block::LongIndices, Block::ShortIndices];

/// The numbers of a file: each block with its bytes, and the accessors with the blocks that they read.
#[derive(Default)]
struct Data {
    blocks: [Vec<u8>; 4],
    accessors: Vec<(Block, Value)>,
}

impl Data {
    /// The description of a primitive, whose numbers are added; `None` if it shows nothing.
    fn primitive(&mut self, primitive: &Primitive, material: usize) -> Option<Value> {
        let (mode, positions, indices): (u32, &[[f32; 3]], &[u32]) = match primitive {
            Primitive::Triangles { positions, triangles, .. } if !triangles.is_empty() => {
                (TRIANGLES, positions, triangles.as_flattened())
            }
            Primitive::Lines { positions, lines, .. } if !lines.is_empty() => {
                (LINES, positions, lines.as_flattened())
            }
            Primitive::Strip { positions, .. } if positions.len() > 1 => (LINE_STRIP, positions, &[]),
            _ => return None,
        };
        let mut attributes = json!({ "POSITION": self.positions(positions) });
        match primitive {
            Primitive::Triangles { normals, .. } if !normals.is_empty() => {
                attributes["NORMAL"] = self.vectors(normals, turned, |_| {}).into();
            }
            Primitive::Strip { colors, .. } | Primitive::Lines { colors, .. } if !colors.is_empty() => {
                attributes["COLOR_0"] = self.colors(colors).into();
            }
            _ => {}
        }
        let mut described = json!({ "attributes": attributes, "mode": mode, "material": material });
        if !indices.is_empty() {
            described["indices"] = self.indices(indices, positions.len()).into();
        }
        Some(described)
    }

    /// Adds numbers to a block, and an accessor that reads them; returns its number.
    fn add(&mut self, block: Block, numbers: &[u8], described: Value) -> usize {
        let bytes = &mut self.blocks[block as usize];
        let mut described = described;
        described["byteOffset"] = bytes.len().into();
        bytes.extend_from_slice(numbers);
        self.accessors.push((block, described));
        self.accessors.len() - 1
    }

    /// Adds vectors as `convert` returns them; calls `visit` with each.
    fn vectors(
        &mut self,
        vectors: &[[f32; 3]],
        convert: fn([f32; 3]) -> [f32; 3],
        mut visit: impl FnMut(&[f32; 3]),
    ) -> usize {
        let mut bytes: Vec<[u8; 12]> = Vec::with_capacity(vectors.len());
        for vector in vectors {
            let vector = convert(*vector);
            visit(&vector);
            let mut all = [0; 12];
            all[..4].copy_from_slice(&vector[0].to_le_bytes());
            all[4..8].copy_from_slice(&vector[1].to_le_bytes());
            all[8..].copy_from_slice(&vector[2].to_le_bytes());
            bytes.push(all);
        }
        let described = json!({ "componentType": FLOAT, "count": vectors.len(), "type": "VEC3" });
        self.add(Block::Vectors, bytes.as_flattened(), described)
    }

    fn positions(&mut self, points: &[[f32; 3]]) -> usize {
        let (mut min, mut max) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        let accessor = self.vectors(points, placed, |point| {
            for axis in 0..3 {
                (min[axis], max[axis]) = (min[axis].min(point[axis]), max[axis].max(point[axis]));
            }
        });
        let described = &mut self.accessors[accessor].1;
        (described["min"], described["max"]) = (json!(min), json!(max));
        accessor
    }

    fn colors(&mut self, colors: &[[u8; 3]]) -> usize {
        let light = &*LIGHT;
        let mut bytes: Vec<[u8; 2]> = Vec::with_capacity(colors.len() * 4);
        for color in colors {
            for channel in color {
                bytes.push(light[usize::from(*channel)].to_le_bytes());
            }
            bytes.push(u16::MAX.to_le_bytes());
        }
        let described = json!({
            "componentType": UNSIGNED_SHORT, "normalized": true, "count": colors.len(), "type": "VEC4",
        });
        self.add(Block::Colors, bytes.as_flattened(), described)
    }

    fn indices(&mut self, indices: &[u32], vertices: usize) -> usize {
        // The largest number of each size restarts a line in some viewers.
        let (block, kind) = match vertices < usize::from(u16::MAX) {
            true => (Block::ShortIndices, UNSIGNED_SHORT),
            false => (Block::LongIndices, UNSIGNED_INT),
        };
        let described = json!({ "componentType": kind, "count": indices.len(), "type": "SCALAR" });
        match block {
            Block::ShortIndices => {
                let mut bytes: Vec<[u8; 2]> = Vec::with_capacity(indices.len());
                for index in indices {
                    bytes.push((*index as u16).to_le_bytes());
                }
                self.add(block, bytes.as_flattened(), described)
            }
            _ => {
                let mut bytes: Vec<[u8; 4]> = Vec::with_capacity(indices.len());
                for index in indices {
                    bytes.push(index.to_le_bytes());
                }
                self.add(block, bytes.as_flattened(), described)
            }
        }
    }

    /// Writes the blocks one after another; returns the views of the buffer, and the accessors.
    fn laid_out(self, buffer: &mut Vec<u8>) -> (Vec<Value>, Vec<Value>) {
        let mut views = Vec::new();
        let mut numbers = [0; BLOCKS.len()];
        for block in BLOCKS {
            let bytes = &self.blocks[block as usize];
            if bytes.is_empty() {
                continue;
            }
            let mut view = json!({ "buffer": 0, "byteOffset": buffer.len(), "byteLength": bytes.len() });
            let (stride, target) = match block {
                Block::Vectors => (Some(12), VERTICES),
                Block::Colors => (Some(8), VERTICES),
                Block::LongIndices | Block::ShortIndices => (None, INDICES),
            };
            view["target"] = target.into();
            if let Some(stride) = stride {
                view["byteStride"] = stride.into();
            }
            numbers[block as usize] = views.len();
            views.push(view);
            buffer.extend_from_slice(bytes);
        }
        let accessors = self.accessors.into_iter().map(|(block, mut accessor)| {
            accessor["bufferView"] = numbers[block as usize].into();
            accessor
        });
        (views, accessors.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gltf::Glb;

    fn strip(points: &[[f32; 3]]) -> Primitive {
        Primitive::Strip { positions: points.to_vec(), colors: vec![[17, 24, 39]; points.len()] }
    }

    fn scene(primitives: Vec<Primitive>) -> Scene {
        let material = Material { color: [255, 0, 188], is_lit: false };
        let node = Node { name: "line".into(), material, primitives };
        Scene { name: "root \"\u{7}".into(), extras: json!({ "a": [1, 2] }), nodes: vec![node] }
    }

    #[test]
    fn points_are_in_metres_with_y_up() {
        let bytes = write(&scene(vec![strip(&[[1000.0, 2000.0, 3000.0], [0.0, 0.0, -500.0]])]), "test");
        let glb = Glb::from_slice(&bytes).unwrap();
        let document = gltf::Gltf::from_slice(&bytes).unwrap();
        let binary = glb.bin.unwrap();
        let root = document.scenes().next().unwrap().nodes().next().unwrap();
        assert_eq!(root.name(), Some("root \"\u{7}"));
        let node = root.children().next().unwrap();
        let primitive = node.mesh().unwrap().primitives().next().unwrap();
        assert_eq!(primitive.mode(), gltf::mesh::Mode::LineStrip);
        let reader = primitive.reader(|_| Some(&binary));
        let points: Vec<_> = reader.read_positions().unwrap().collect();
        assert_eq!(points, [[1.0, 3.0, -2.0], [0.0, -0.5, 0.0]]);
        assert_eq!(points[1][2].to_bits(), 0, "no -0");
        let bounds = primitive.bounding_box();
        assert_eq!((bounds.min, bounds.max), ([0.0, -0.5, -2.0], [1.0, 3.0, 0.0]));
        // 17/255 in sRGB is 0.0056 of linear light.
        let colors = reader.read_colors(0).unwrap().into_rgba_f32().next().unwrap();
        assert!((colors[0] - 0.005_605).abs() < 2e-5 && colors[3] == 1.0, "{colors:?}");
    }

    #[test]
    fn a_scene_without_anything_is_a_valid_file() {
        let bytes = write(&scene(vec![strip(&[[0.0; 3]])]), "test");
        let document = gltf::Gltf::from_slice(&bytes).unwrap();
        assert_eq!((document.meshes().count(), document.nodes().count()), (0, 1));
        assert_eq!(bytes.len() % 4, 0);
    }

    #[test]
    fn long_and_short_indices_follow_each_other() {
        let points = |count: usize| vec![[0.0f32; 3]; count];
        let small = || Primitive::Lines {
            positions: points(3),
            colors: Vec::new(),
            lines: vec![[0, 1], [1, 2], [2, 0]],
        };
        let triangle =
            Primitive::Triangles { positions: points(3), normals: Vec::new(), triangles: vec![[2, 1, 0]] };
        let large =
            Primitive::Lines { positions: points(70_000), colors: Vec::new(), lines: vec![[0, 69_999]] };
        let bytes = write(&scene(vec![small(), triangle, large, small()]), "test");
        let binary = Glb::from_slice(&bytes).unwrap().bin.unwrap();
        let document = gltf::Gltf::from_slice(&bytes).unwrap();
        let mesh = document.meshes().next().unwrap();
        let indices: Vec<Vec<u32>> = mesh
            .primitives()
            .map(|primitive| primitive.reader(|_| Some(&binary)).read_indices().unwrap().into_u32().collect())
            .collect();
        let pairs = vec![0, 1, 1, 2, 2, 0];
        assert_eq!(indices, [pairs.clone(), vec![2, 1, 0], vec![0, 69_999], pairs]);
    }
}
