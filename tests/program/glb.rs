//! Parts with closed forms as GLB: metres, +Y up, with exact normals.

use serde_json::{Value, json};

/// A point or direction of the part frame: mm, +Z up.
pub type Vector = [f64; 3];

/// A GLB file under construction.
#[derive(Default)]
pub struct Glb {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    materials: Vec<Value>,
    nodes: Vec<Value>,
}

/// A marking frame of the part frame.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    pub origin: Vector,
    pub z: Vector,
    pub x: Vector,
}

impl Glb {
    /// Adds a mesh of `size` cells over the unit square; `surface` gives point and outward normal for each place in it,
    /// whose right and up, seen from outside, are u and v.
    pub fn grid(
        mut self,
        name: &str,
        material: Option<&str>,
        size: [usize; 2],
        surface: impl Fn(f64, f64) -> (Vector, Vector),
    ) -> Self {
        let [columns, rows] = size;
        let at = |index: usize| {
            let (column, row) = (index % (columns + 1), index / (columns + 1));
            surface(column as f64 / columns as f64, row as f64 / rows as f64)
        };
        let points: Vec<(Vector, Vector)> = (0..(columns + 1) * (rows + 1)).map(at).collect();
        let cell = |index: usize| {
            let lower = (index / columns) * (columns + 1) + index % columns;
            let upper = lower + columns + 1;
            [lower, lower + 1, upper + 1, lower, upper + 1, upper]
        };
        let corners: Vec<u32> = (0..columns * rows).flat_map(cell).map(|corner| corner as u32).collect();
        let positions = points.iter().flat_map(|(point, _)| y_up(point.map(|value| value / 1000.0)));
        let positions: Vec<u8> = positions.flat_map(|value| (value as f32).to_le_bytes()).collect();
        let normals = points.iter().flat_map(|(_, normal)| y_up(*normal));
        let normals: Vec<u8> = normals.flat_map(|value| (value as f32).to_le_bytes()).collect();
        let indices: Vec<u8> = corners.iter().flat_map(|corner| corner.to_le_bytes()).collect();
        let position = self.accessor(&positions, 5126, points.len(), "VEC3");
        let normal = self.accessor(&normals, 5126, points.len(), "VEC3");
        let indices = self.accessor(&indices, 5125, corners.len(), "SCALAR");
        let mut primitive =
            json!({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices});
        if let Some(material) = material {
            primitive["material"] = self.materials.len().into();
            self.materials.push(json!({"name": material}));
        }
        self.nodes.push(json!({"name": name, "mesh": self.meshes.len()}));
        self.meshes.push(json!({"name": name, "primitives": [primitive]}));
        self
    }

    /// A can without lids: radius and height, mm, upright on z = 0 about the z axis.
    pub fn can(self, radius: f64, height: f64) -> Self {
        self.can_from_to("can", None, radius, [0.0, height], [0.0, std::f64::consts::TAU])
    }

    /// A piece of such a can, from one height and angle to another; angles are counter-clockwise from −y.
    pub fn can_from_to(
        self,
        name: &str,
        material: Option<&str>,
        radius: f64,
        heights: [f64; 2],
        angles: [f64; 2],
    ) -> Self {
        let columns = ((angles[1] - angles[0]) * 24.0).ceil() as usize;
        self.grid(name, material, [columns, 12], |u, v| {
            let angle = angles[0] + (angles[1] - angles[0]) * u;
            let normal = around(angle);
            let height = heights[0] + (heights[1] - heights[0]) * v;
            ([radius * normal[0], radius * normal[1], height], normal)
        })
    }

    /// Adds the node of a marking frame.
    pub fn frame(self, frame: &Frame) -> Self {
        self.named_frame("isomark", frame)
    }

    /// Adds the node of a marking frame under another name.
    pub fn named_frame(self, name: &str, frame: &Frame) -> Self {
        // The node's own axes are turned like the part: its y axis is the frame's z.
        let [x, up, front] = [frame.x, frame.z, negative(cross(frame.z, frame.x))].map(y_up);
        let origin = y_up(frame.origin.map(|value| value / 1000.0));
        self.node(json!({"name": name, "translation": origin, "rotation": quaternion([x, up, front])}))
    }

    /// Adds a node.
    pub fn node(mut self, node: Value) -> Self {
        self.nodes.push(node);
        self
    }

    fn accessor(&mut self, bytes: &[u8], component: u32, count: usize, kind: &str) -> usize {
        self.views.push(json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()}));
        self.binary.extend(bytes);
        let view = self.views.len() - 1;
        self.accessors
            .push(json!({"bufferView": view, "componentType": component, "count": count, "type": kind}));
        self.accessors.len() - 1
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut document = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": (0..self.nodes.len()).collect::<Vec<_>>()}],
            "nodes": self.nodes,
            "meshes": self.meshes,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": self.binary.len()}],
        });
        if !self.materials.is_empty() {
            document["materials"] = self.materials.clone().into();
        }
        let mut json = document.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut file = b"glTF".to_vec();
        file.extend(2u32.to_le_bytes());
        file.extend((12 + 8 + json.len() as u32 + 8 + self.binary.len() as u32).to_le_bytes());
        for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &self.binary)] {
            file.extend((chunk.len() as u32).to_le_bytes());
            file.extend(kind);
            file.extend(chunk);
        }
        file
    }
}

impl Frame {
    /// The frame on an upright can at this angle and height, with its x turned counter-clockwise from the direction round
    /// the can.
    pub fn on_can(radius: f64, angle: f64, height: f64, turn: f64) -> Self {
        let (z, round) = (around(angle), [angle.cos(), angle.sin(), 0.0]);
        let x = [round[0] * turn.cos(), round[1] * turn.cos(), turn.sin()];
        Self { origin: [radius * z[0], radius * z[1], height], z, x }
    }

    /// A point of the part frame in the view that the frame gives: x to the right, y up.
    pub fn view(&self, point: Vector) -> [f64; 2] {
        [dot(self.x, point), dot(cross(self.z, self.x), point)]
    }

    /// As the command line takes it.
    pub fn option(&self) -> String {
        [self.origin, self.z, self.x].map(|[x, y, z]| format!("{x},{y},{z}")).join(" ")
    }
}

/// The direction from the z axis at this angle, counter-clockwise from −y.
pub fn around(angle: f64) -> Vector {
    [angle.sin(), -angle.cos(), 0.0]
}

pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn negative(vector: Vector) -> Vector {
    vector.map(|value| -value)
}

/// A vector with +Z up in the axes of glTF.
fn y_up([x, y, z]: Vector) -> Vector {
    [x, z, -y]
}

/// The quaternion (x, y, z, w) of the rotation with these columns.
fn quaternion([x, y, z]: [Vector; 3]) -> [f64; 4] {
    // The eigenvector to 1 of a rotation is hard to find near half a turn, so the largest component comes first.
    let squares = [
        1.0 + x[0] - y[1] - z[2],
        1.0 - x[0] + y[1] - z[2],
        1.0 - x[0] - y[1] + z[2],
        1.0 + x[0] + y[1] + z[2],
    ];
    let largest = (0..4).max_by(|&a, &b| squares[a].total_cmp(&squares[b])).unwrap();
    let (a, b, c) = (y[2] - z[1], z[0] - x[2], x[1] - y[0]);
    let (d, e, f) = (x[1] + y[0], z[0] + x[2], y[2] + z[1]);
    let quaternion = match largest {
        0 => [squares[0], d, e, a],
        1 => [d, squares[1], f, b],
        2 => [e, f, squares[2], c],
        _ => [a, b, c, squares[3]],
    };
    let length = quaternion.iter().map(|value| value * value).sum::<f64>().sqrt();
    quaternion.map(|value| value / length)
}
