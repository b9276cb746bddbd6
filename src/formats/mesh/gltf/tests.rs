use std::io;

use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::*;
use crate::formats::mesh::error::{EmptyCause, VertexPlace};
use crate::formats::mesh::{self, MeshOptions, NormalsFound, PartReading};

/// A GLB of one mesh, a right triangle with legs of 1 m along x and y and its normals, after `change` edited its JSON.
fn glb_with(change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let floats =
        [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    let mut binary: Vec<u8> = floats.iter().flat_map(|value| value.to_le_bytes()).collect();
    binary.extend([0u16, 1, 2, 0].iter().flat_map(|index| index.to_le_bytes()));
    let mut document = json!({
        "asset": {"version": "2.0", "generator": "a test"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "Body"}],
        "meshes": [{"name": "Shape", "primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 72},
            {"buffer": 0, "byteOffset": 72, "byteLength": 8},
        ],
        "buffers": [{"byteLength": 80}],
    });
    change(&mut document);
    container(&document, &binary)
}

fn container(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let length = 12 + 8 + json.len() + 8 + binary.len();
    file.extend(2u32.to_le_bytes());
    file.extend((length as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", binary)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    file
}

fn read_glb(bytes: &[u8]) -> Result<PartReading, MeshReadError> {
    mesh::read(bytes, MeshFormat::Glb, &MeshOptions::default(), &BTreeMap::new())
}

fn read_with(change: impl FnOnce(&mut Value)) -> Result<PartReading, MeshReadError> {
    read_glb(&glb_with(change))
}

/// The sum of the triangles' areas as vectors, m².
fn area(part: &PartReading) -> Vector3<f64> {
    let of = |corners| {
        let [a, b, c]: [Point3<f64>; 3] = part.shape.mesh().unwrap().corners(corners);
        (b - a).cross(&(c - a)) / 2e6
    };
    part.shape.mesh().unwrap().triangles().iter().map(|&corners| of(corners)).sum()
}

fn is_near(a: Vector3<f64>, b: [f64; 3]) -> bool {
    (a - Vector3::from(b)).norm() < 1e-6
}

#[test]
fn metres_with_y_up_become_millimetres_with_z_up() {
    let part = read_with(|_| {}).unwrap();
    assert_eq!(part.facts.size, [1000.0, 0.0, 1000.0]);
    assert!(is_near(area(&part), [0.0, -0.5, 0.0]));
    assert_eq!(part.shape.mesh().unwrap().normals()[0], -Vector3::y());
    assert_eq!(part.facts.bodies, ["Body"]);
    assert_eq!(part.facts.producer.as_deref(), Some("a test"));
}

#[test]
fn transforms_of_nodes_are_composed_and_mirrors_reverse_triangles() {
    let part = read_with(|document| {
        document["nodes"] = json!([
            {"children": [1], "translation": [1, 2, 3], "rotation": [0, 0, 1, 1]},
            {"mesh": 0, "scale": [-2, 1, 1]},
        ]);
    })
    .unwrap();
    // Mirrored in x and rotated to y, the triangle still faces +z of the file, which is -y here.
    assert!(is_near(area(&part), [0.0, -1.0, 0.0]), "{}", area(&part));
    assert!((part.shape.mesh().unwrap().normals()[0] + Vector3::y()).norm() < 1e-9);
    let (min, max) = part.shape.mesh().unwrap().bounds();
    assert!(is_near(min.coords / 1000.0, [0.0, -3.0, 0.0]), "{min}");
    assert!(is_near(max.coords / 1000.0, [1.0, -3.0, 2.0]), "{max}");
}

#[test]
fn normals_stay_perpendicular_under_shear() {
    let part = read_with(|document| {
        document["nodes"][0]["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 2, 0, 1, 0, 0, 0, 0, 1]);
    })
    .unwrap();
    let normal = part.shape.mesh().unwrap().normals()[0];
    let [a, b, c] = part.shape.mesh().unwrap().corners(part.shape.mesh().unwrap().triangles()[0]);
    assert!(normal.dot(&(b - a)).abs() < 1e-9 && normal.dot(&(c - a)).abs() < 1e-9);
}

#[test]
fn strips_and_fans_become_triangles_of_one_orientation() {
    let square = |mode: u32| {
        let corners = [[0.0f32, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let order = if mode == 5 { [0, 1, 2, 3] } else { [0, 1, 3, 2] };
        let floats = order.iter().flat_map(|&at: &usize| [corners[at][0], corners[at][1], 0.0]);
        let binary: Vec<u8> = floats.flat_map(f32::to_le_bytes).collect();
        let document = json!({
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
            "bufferViews": [{"buffer": 0, "byteLength": 48}],
            "buffers": [{"byteLength": 48}],
        });
        read_glb(&container(&document, &binary)).unwrap()
    };
    for mode in [5, 6] {
        let part = square(mode);
        assert_eq!(part.facts.triangles, 2, "mode {mode}");
        assert!(is_near(area(&part), [0.0, -1.0, 0.0]), "mode {mode}");
        assert_eq!(part.facts.normals, mesh::NormalsFound::None);
    }
}

#[test]
fn primitives_that_are_not_surfaces_are_reported() {
    let part = read_with(|document| {
        let line = json!({"attributes": {"POSITION": 0}, "mode": 3});
        let points = json!({"attributes": {"POSITION": 0}, "mode": 0});
        let primitives = document["meshes"][0]["primitives"].as_array_mut().unwrap();
        primitives.extend([line.clone(), line, points]);
        document["nodes"][0]["camera"] = json!(0);
    })
    .unwrap();
    let named = ["1 x camera", "2 x set of lines", "1 x set of points"];
    assert_eq!(part.facts.skipped, named);
    let only_lines = read_with(|document| document["meshes"][0]["primitives"][0]["mode"] = json!(1));
    let cause = EmptyCause::OnlyOthers(vec!["1 x set of lines".into()]);
    assert_eq!(only_lines, Err(MeshReadError::NoTriangles { cause }));
}

#[test]
fn sparse_values_replace_elements() {
    let part = read_with(|document| {
        // The second vertex takes the place of the third normal, (0, 0, 1).
        document["accessors"][0]["sparse"] = json!({
            "count": 1,
            "indices": {"bufferView": 1, "byteOffset": 2, "componentType": 5123},
            "values": {"bufferView": 0, "byteOffset": 60},
        });
    })
    .unwrap();
    assert_eq!(part.facts.size, [0.0, 1000.0, 1000.0]);
    let beyond = read_with(|document| {
        document["accessors"][0]["count"] = json!(4_000_000_000u32);
        document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        document["accessors"][0]["sparse"] = json!({
            "count": 1,
            "indices": {"bufferView": 1, "componentType": 5123},
            "values": {"bufferView": 0},
        });
    });
    assert!(matches!(beyond, Err(MeshReadError::DataBeyondBuffer { .. })), "{beyond:?}");
}

#[test]
fn unsorted_sparse_values_are_refused_and_empty_ones_have_no_effect() {
    let with = |count: u32, offset: u32| {
        read_with(|document| {
            // The vertex indices 0, 1, 2, 0 from `offset` bytes on serve as sparse indices.
            document["accessors"][0]["sparse"] = json!({
                "count": count,
                "indices": {"bufferView": 1, "byteOffset": offset, "componentType": 5123},
                "values": {"bufferView": 0},
            });
        })
    };
    assert_eq!(with(3, 0).map(|part| part.facts.size), Ok([1000.0, 0.0, 1000.0]));
    assert_eq!(with(0, 0).map(|part| part.facts.size), Ok([1000.0, 0.0, 1000.0]));
    let unsorted = with(2, 4);
    assert!(matches!(unsorted, Err(MeshReadError::WrongData { .. })), "{unsorted:?}");
    let beyond = read_with(|document| {
        document["accessors"][0]["count"] = json!(2);
        document["accessors"][0]["sparse"] = json!({
            "count": 1,
            "indices": {"bufferView": 1, "byteOffset": 4, "componentType": 5123},
            "values": {"bufferView": 0},
        });
    });
    let kind = "sparse element";
    assert!(matches!(beyond, Err(MeshReadError::BrokenReference { kind: found, .. }) if found == kind));
}

#[test]
fn invalid_strides_and_counts_are_refused() {
    let strided =
        |stride: u32| read_with(|document| document["bufferViews"][0]["byteStride"] = json!(stride));
    assert_eq!(strided(0), strided(12));
    for stride in [1, 4, 11] {
        let overlapping = strided(stride);
        assert!(matches!(overlapping, Err(MeshReadError::WrongData { .. })), "{stride}: {overlapping:?}");
    }
    let empty = read_with(|document| document["accessors"][2]["count"] = json!(0));
    assert!(matches!(empty, Err(MeshReadError::NoTriangles { .. })), "{empty:?}");
    let nothing = read_with(|document| document["accessors"][0]["count"] = json!(0));
    assert!(matches!(nothing, Err(MeshReadError::IndexOutOfRange { count: 0, .. })), "{nothing:?}");
}

#[test]
fn data_that_are_missing_or_of_another_type_are_refused() {
    let quantised = read_with(|document| document["accessors"][0]["componentType"] = json!(5122));
    let item = "mesh \"Shape\", primitive 0, POSITION".to_string();
    let (expected, found) = ("three 32-bit floats", "vec3 of i16".to_string());
    assert_eq!(quantised, Err(MeshReadError::WrongData { item: item.clone(), expected, found }));

    let compressed = read_with(|document| {
        document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    });
    assert_eq!(compressed, Err(MeshReadError::NoData { item: item.clone() }));

    let beyond = read_with(|document| document["accessors"][0]["count"] = json!(7));
    assert_eq!(
        beyond,
        Err(MeshReadError::DataBeyondBuffer { item: item.clone(), needed: 84, available: 72 })
    );
    let huge = read_with(|document| document["accessors"][0]["count"] = json!(u64::MAX));
    assert!(matches!(huge, Err(MeshReadError::DataBeyondBuffer { .. })), "{huge:?}");

    let nowhere = read_with(|document| document["accessors"] = json!([]));
    assert_eq!(nowhere, Err(MeshReadError::BrokenReference { item, kind: "accessor", index: 0, count: 0 }));
    for pointer in
        ["/scene", "/scenes/0/nodes/0", "/nodes/0/mesh", "/bufferViews/0/buffer", "/accessors/2/bufferView"]
    {
        let broken = read_with(|document| *document.pointer_mut(pointer).unwrap() = json!(9));
        assert!(
            matches!(broken, Err(MeshReadError::BrokenReference { index: 9, .. })),
            "{pointer}: {broken:?}"
        );
    }
}

#[test]
fn bad_numbers_are_refused_with_their_place() {
    let mut bytes = glb_with(|_| {});
    let at = bytes.len() - 80 + 4 * 4;
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let vertex = VertexPlace::Gltf { mesh: "Shape".into(), primitive: 0, vertex: 1 };
    match read_glb(&bytes) {
        Err(MeshReadError::NotFinite { vertex: found, coordinate }) => {
            assert_eq!(found, vertex);
            assert!(coordinate[1].is_nan());
        }
        other => panic!("{other:?}"),
    }
    let mut bytes = glb_with(|_| {});
    let at = bytes.len() - 6;
    bytes[at] = 77;
    let out_of_range = MeshReadError::IndexOutOfRange { face: vertex, kind: "vertex", index: 77, count: 3 };
    assert_eq!(read_glb(&bytes), Err(out_of_range));

    let far = read_with(|document| document["nodes"][0]["translation"] = json!([1e30, 0, 0]));
    assert!(matches!(far, Err(MeshReadError::TooFar { .. })), "{far:?}");
    let matrix = json!([1e38, 0, 0, 0, 0, 1e38, 0, 0, 0, 0, 1e38, 0, 0, 0, 0, 1]);
    let chain = read_with(|document| {
        let child = |at: usize| json!({"matrix": matrix, "children": [at + 1]});
        document["nodes"] = (0..12).map(child).collect();
        document["nodes"][11] = json!({"mesh": 0});
    });
    assert!(matches!(chain, Err(MeshReadError::BadTransform { .. })), "{chain:?}");
}

#[test]
fn cycles_and_shared_children_are_refused_and_deep_trees_are_read() {
    let cycle =
        read_with(|document| document["nodes"] = json!([{"children": [1]}, {"children": [0], "name": "B"}]));
    assert_eq!(cycle, Err(MeshReadError::NodeTwice { node: "node 0".into() }));
    let shared =
        read_with(|document| document["nodes"] = json!([{"children": [1, 1]}, {"mesh": 0, "name": "B"}]));
    assert_eq!(shared, Err(MeshReadError::NodeTwice { node: "node \"B\"".into() }));
    let deep = read_with(|document| {
        let depth = 20_000;
        document["nodes"] = (0..depth).map(|at| json!({"children": [at + 1]})).collect();
        document["nodes"].as_array_mut().unwrap().push(json!({"mesh": 0}));
    });
    assert_eq!(deep.unwrap().facts.triangles, 1);
}

#[test]
fn containers_that_are_cut_off_or_foreign_are_refused() {
    let whole = glb_with(|_| {});
    let declared = whole.len() as u64;
    let actual = declared - 5;
    let cut = read_glb(&whole[..actual as usize]);
    assert_eq!(cut, Err(MeshReadError::Truncated { format: MeshFormat::Glb, declared, actual }));
    for length in 4..whole.len() {
        assert!(matches!(read_glb(&whole[..length]), Err(MeshReadError::Truncated { .. })), "{length} bytes");
    }
    let mut first_version = whole.clone();
    first_version[4] = 1;
    assert_eq!(read_glb(&first_version), Err(MeshReadError::Version { version: "1".into() }));
    let step = MeshReadError::OtherFormat { format: MeshFormat::Glb, found: mesh::Content::Step };
    assert_eq!(read_glb(b"ISO-10303-21;\n"), Err(step));
    assert_eq!(read_glb(b""), Err(MeshReadError::EmptyFile));
    assert_eq!(mesh::named_files(b"", MeshFormat::Glb).err(), Some(MeshReadError::EmptyFile));
    let found = "\"ISO-10303-22;\\n\"".into();
    let refused = MeshReadError::NotThisFormat { format: MeshFormat::Glb, found };
    assert_eq!(read_glb(b"ISO-10303-22;\n"), Err(refused));
    let mut longer = whole;
    longer.extend([0; 3]);
    let notices = read_glb(&longer).unwrap().facts.notices;
    assert_eq!(notices[0].code, "glb-trailing-bytes");
    match read_glb(b"{\n \"asset\": {\"version\": \"2.0\"},\n \"nodes\": [}") {
        Err(MeshReadError::BadJson { line: 3, column: 12, .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn extensions_that_change_shapes_are_refused_by_name() {
    for name in ["VENDOR_bend", "CESIUM_RTC"] {
        let refused = read_with(|document| document["extensionsRequired"] = json!([name]));
        assert_eq!(refused, Err(MeshReadError::UnsupportedExtension { name: name.into() }));
    }
    let harmless = json!(["KHR_materials_unlit", "KHR_texture_transform"]);
    assert!(read_with(|document| document["extensionsRequired"] = harmless).is_ok());
}

#[test]
fn an_unmeshed_export_names_its_likely_cause() {
    let empty = json!({
        "asset": {"version": "2.0", "generator": "Open CASCADE Technology 7.6 [dev.opencascade.org]"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"name": "Can"}],
    });
    let refused = read_glb(empty.to_string().as_bytes()).unwrap_err();
    assert_eq!(refused, MeshReadError::NoTriangles { cause: EmptyCause::NeverMeshed });
    assert!(refused.reason().remedy.contains("Mesh the shape first"));
}

#[test]
fn buffers_are_read_from_data_uris_and_the_part_folder_only() {
    let whole = glb_with(|_| {});
    let binary = whole[whole.len() - 80..].to_vec();
    let text_with = |uri: &str| {
        let glb = glb_with(|document| document["buffers"][0]["uri"] = json!(uri));
        Container::split(&glb, MeshFormat::Glb).unwrap().json.to_vec()
    };
    let read_beside = |uri: &str, name: &str, data: &[u8]| {
        let siblings = BTreeMap::from([(name.to_string(), data.to_vec())]);
        mesh::read(&text_with(uri), MeshFormat::Gltf, &MeshOptions::default(), &siblings)
    };
    // Only the named file is read, not other files beside it.
    let read_text = |uri: &str, data: Option<&[u8]>| match data {
        Some(data) => read_beside(uri, "part.bin", data),
        None => read_beside(uri, "other.bin", &binary),
    };
    assert_eq!(read_beside("my%20part.bin", "my part.bin", &binary).unwrap().facts.triangles, 1);
    assert_eq!(read_text("./part.bin", Some(&binary)).unwrap().facts.triangles, 1);
    let name = || "part.bin".to_string();
    let missing = MeshReadError::BufferMissing { name: name(), kind: io::ErrorKind::NotFound };
    assert_eq!(read_text("part.bin", None), Err(missing));
    let short = MeshReadError::BufferShort { name: "\"part.bin\"".into(), declared: 80, actual: 79 };
    assert_eq!(read_text("part.bin", Some(&binary[..79])), Err(short));
    for uri in
        ["../part.bin", "/etc/part.bin", "http://x/part.bin", "C:\\part.bin", "..%2Fpart.bin", "", ".."]
    {
        let refused = read_text(uri, Some(&binary));
        assert!(matches!(refused, Err(MeshReadError::BufferName { .. })), "{uri}: {refused:?}");
        assert!(named_files(&text_with(uri), MeshFormat::Gltf).is_err(), "{uri}");
    }
    let encoded = format!("data:application/octet-stream;base64,{}", base64(&binary));
    assert_eq!(read_text(&encoded, None).unwrap().facts.triangles, 1);
    assert_eq!(read_text("data:;base64,@@", None), Err(MeshReadError::BadDataUri { buffer: 0 }));
    let named =
        NamedFiles { buffers: vec![Buffer { name: "my part.bin".into(), bytes: 80 }], textures: Vec::new() };
    assert_eq!(named_files(&text_with("my%20part.bin"), MeshFormat::Gltf), Ok(named));
    assert_eq!(named_files(&whole, MeshFormat::Glb), Ok(NamedFiles::default()));
}

fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let bits =
            three.iter().fold(0u32, |bits, &byte| bits << 8 | u32::from(byte)) << (8 * (3 - three.len()));
        for at in 0..=three.len() {
            text.push(LETTERS[(bits >> (18 - 6 * at) & 63) as usize] as char);
        }
        (three.len()..3).for_each(|_| text.push('='));
    }
    text
}

#[test]
fn textures_beside_the_part_are_listed() {
    let images =
        r#"[{"uri": "wood%20grain.png"}, {"uri": "data:image/png;base64,AA=="}, {"uri": "../x.png"}]"#;
    let bytes = format!(r#"{{"asset": {{"version": "2.0"}}, "images": {images}}}"#);
    let named = named_files(bytes.as_bytes(), MeshFormat::Gltf).unwrap();
    assert_eq!((named.buffers.len(), named.textures), (0, vec!["wood grain.png".to_string()]));
    assert!(named_files(b"not glTF", MeshFormat::Gltf).is_err());
}

/// Nodes can share a mesh and primitives an accessor, so a few bytes can produce any number of triangles.
#[test]
fn copies_of_few_bytes_are_limited_and_refused_at_a_quick_pace() {
    let copies = |count: usize, shared_by_nodes: bool| {
        let floats = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let mut binary: Vec<u8> = floats.iter().flat_map(|value| value.to_le_bytes()).collect();
        binary.extend([0u8, 1, 2].repeat(10_000));
        let primitive = json!({"attributes": {"POSITION": 0}, "indices": 1});
        let (nodes, primitives) = if shared_by_nodes { (count, 1) } else { (1, count) };
        let document = json!({
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": (0..nodes).collect::<Vec<_>>()}],
            "nodes": vec![json!({"mesh": 0}); nodes],
            "meshes": [{"primitives": vec![primitive; primitives]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5121, "count": 30_000, "type": "SCALAR"},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 30_000}],
            "buffers": [{"byteLength": binary.len()}],
        });
        container(&document, &binary)
    };
    let quick = MeshOptions { pace: Pace::Quick, ..MeshOptions::default() };
    let read_quickly = |bytes: &[u8]| mesh::read(bytes, MeshFormat::Glb, &quick, &BTreeMap::new());
    for by_nodes in [true, false] {
        let few = copies(3, by_nodes);
        assert_eq!(read_quickly(&few).unwrap().facts.triangles, read_glb(&few).unwrap().facts.triangles);
        let many = copies(30, by_nodes);
        assert_eq!(read_quickly(&many), Err(MeshReadError::TakesLong));
        assert!(read_glb(&many).is_ok());
        let refused = read_glb(&copies(201, by_nodes));
        let is_limited =
            matches!(refused, Err(MeshReadError::TooLarge { what: "triangles", limit: 2_000_000, .. }));
        assert!(is_limited, "{:?}", refused.map(|part| part.facts.triangles));
    }
    // Vertices without triangles take memory, too.
    let vertices = {
        let binary = vec![0; 12 * 10_000];
        let document = json!({
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": (0..301).collect::<Vec<_>>()}],
            "nodes": vec![json!({"mesh": 0}); 301],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 10_000, "type": "VEC3"}],
            "bufferViews": [{"buffer": 0, "byteLength": binary.len()}],
            "buffers": [{"byteLength": binary.len()}],
        });
        container(&document, &binary)
    };
    let refused = read_glb(&vertices);
    assert!(matches!(refused, Err(MeshReadError::TooLarge { what: "vertices", .. })), "{refused:?}");
}

/// A part of the tests' data: an arch of radius 30 mm over 120 degrees, 40 mm wide, with its axis along y.
fn arch(name: &str) -> Vec<u8> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parts/arch").join(name);
    std::fs::read(&path).unwrap()
}

/// Checks size, number of triangles, vertices and normals of an arch against the formula of a cylinder.
fn check_arch(name: &str, tolerance: f64) {
    let part = read_glb(&arch(name)).unwrap();
    let mesh = part.shape.mesh().unwrap();
    let expected = [60.0 * (std::f64::consts::FRAC_PI_3).sin(), 40.0, 15.0];
    let is_right = part
        .facts
        .size
        .iter()
        .zip(expected)
        .all(|(size, expected)| (size - expected).abs() < 2.0 * tolerance);
    assert!(is_right, "{name}: {:?}", part.facts.size);
    assert_eq!(part.facts.triangles, 48 * 12 * 2, "{name}");
    let off = mesh.positions().iter().map(|point| (point.x.hypot(point.z) - 30.0).abs()).fold(0.0, f64::max);
    assert!(off < tolerance, "{name}: {off} mm from the cylinder");
    assert_eq!(part.facts.normals, NormalsFound::Smooth, "{name}");
    for (point, normal) in mesh.positions().iter().zip(mesh.normals()) {
        let radial = Vector3::new(point.x, 0.0, point.z) / 30.0;
        assert!((normal - radial).norm() < 0.02, "{name}: {normal} at {point}");
    }
}

#[test]
fn quantised_and_compressed_parts_of_other_programs_are_read() {
    // gltfpack and gltf-transform: 14 bits or more over 52 mm.
    for name in ["pack_quantized.glb", "pack_meshopt.glb", "pack_cz.glb", "pack_float.glb"] {
        check_arch(name, 0.01);
    }
    for name in ["gt_meshopt.glb", "gt_meshopt_m.glb", "gt_draco.glb", "gt_draco_seq.glb"] {
        check_arch(name, 0.01);
    }
}

#[test]
fn damaged_compressed_parts_are_refused_or_read_without_a_panic() {
    for name in ["pack_meshopt.glb", "pack_cz.glb", "pack_float.glb", "gt_draco.glb", "gt_draco_seq.glb"] {
        let bytes = arch(name);
        let json_length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let (start, mut seed) = (28 + json_length, 7u32);
        for _ in 0..40 {
            let mut damaged = bytes.clone();
            for _ in 0..3 {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let at = start + (seed >> 8) as usize % (damaged.len() - start);
                damaged[at] ^= (seed >> 3) as u8 | 1;
            }
            let _ = read_glb(&damaged);
        }
    }
    let wrong = |name: &str, from: &str, to: &str| {
        let bytes = arch(name);
        let text = String::from_utf8_lossy(&bytes[20..]).into_owned();
        let at = 20 + text.find(from).unwrap();
        let mut changed = bytes.clone();
        changed[at..at + to.len()].copy_from_slice(to.as_bytes());
        read_glb(&changed)
    };
    let huge = wrong("pack_meshopt.glb", "\"count\":3456", "\"count\":9999");
    assert!(matches!(huge, Err(MeshReadError::Compressed { .. })), "{huge:?}");
    let mode = wrong("pack_meshopt.glb", "\"ATTRIBUTES\"", "\"ATTRIBUTEX\"");
    assert!(matches!(mode, Err(MeshReadError::Compressed { .. })), "{mode:?}");
    let draco = wrong("gt_draco.glb", "\"POSITION\":", "\"POSITIOX\":");
    assert!(draco.is_err(), "{draco:?}");
}

#[test]
fn whole_numbers_are_positions_only_with_the_extension_for_them() {
    let corners = |kind: u32, bytes: Vec<u8>, normalized: bool, extension: bool| {
        let document = json!({
            "asset": {"version": "2.0"},
            "extensionsUsed": if extension { json!(["KHR_mesh_quantization"]) } else { json!([]) },
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "scale": [0.5, 0.5, 0.5]}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [
                {"bufferView": 0, "componentType": kind, "normalized": normalized, "count": 3, "type": "VEC3"},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": bytes.len(), "byteStride": bytes.len() / 3}],
            "buffers": [{"byteLength": bytes.len()}],
        });
        read_glb(&container(&document, &bytes)).map(|part| part.facts.size)
    };
    let shorts = |values: [i16; 12]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let triangle = shorts([-32_768, 0, 0, 0, 32_767, 0, 0, 0, 0, 32_767, 0, 0]);
    assert_eq!(corners(5122, triangle.clone(), true, true), Ok([1000.0, 0.0, 500.0]));
    assert_eq!(
        corners(5122, shorts([-2, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0]), false, true),
        Ok([2000.0, 0.0, 1000.0])
    );
    let bytes = vec![0, 0, 0, 0, 255, 0, 0, 0, 0, 51, 0, 0];
    let size = corners(5121, bytes.clone(), true, true).unwrap();
    assert!((size[0] - 500.0).abs() < 1e-4 && (size[2] - 100.0).abs() < 1e-4, "{size:?}");
    let negative = vec![128, 0, 0, 0, 127, 0, 0, 0, 0, 127, 0, 0];
    assert_eq!(corners(5120, negative, true, true), Ok([1000.0, 0.0, 500.0]));
    assert!(matches!(corners(5121, bytes, true, false), Err(MeshReadError::WrongData { .. })));
    assert!(matches!(corners(5125, vec![0; 36], true, true), Err(MeshReadError::WrongData { .. })));
}

#[test]
fn documents_with_invalid_looks_and_motion_are_read_and_reported() {
    let notices = |part: &PartReading| -> Vec<String> {
        let found = part.facts.notices.iter().filter(|notice| notice.code == "gltf-repaired");
        found.map(|notice| notice.message.clone()).collect()
    };
    assert!(notices(&read_with(|_| {}).unwrap()).is_empty());
    let without_nodes = read_with(|document| document["scenes"] = json!([{"name": "Scene"}])).unwrap();
    assert_eq!(without_nodes.facts.size, [1000.0, 0.0, 1000.0]);
    assert!(notices(&without_nodes)[0].contains("1 x scene without nodes"), "{without_nodes:?}");
    let invalid = read_with(|document| {
        document["animations"] =
            json!([{"channels": [{"sampler": 0, "target": {"path": "pointer"}}], "samplers": []}]);
        document["materials"] =
            json!([{"name": "steel", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1]}}]);
        document["textures"] = json!([{"extensions": {"KHR_texture_basisu": {"source": 0}}}]);
        document["meshes"][0]["primitives"][0]["material"] = json!(0);
        document["extensionsRequired"] = json!(["KHR_techniques_webgl", "KHR_texture_basisu", "MSFT_lod"]);
    })
    .unwrap();
    assert_eq!(
        (invalid.facts.size, &invalid.facts.materials[..]),
        ([1000.0, 0.0, 1000.0], &["steel".to_owned()][..])
    );
    for what in ["1 x invalid animation", "1 x invalid material"] {
        assert!(notices(&invalid)[0].contains(what), "{what}: {:?}", notices(&invalid));
    }
    let looks = invalid.facts.notices.iter().find(|notice| notice.code == "extension-ignored").unwrap();
    assert!(looks.message.contains("KHR_techniques_webgl, KHR_texture_basisu, MSFT_lod"), "{looks:?}");
    // What changes the shape is still refused, with its place.
    let broken = read_with(|document| document["nodes"][0]["mesh"] = json!("first"));
    assert!(matches!(broken, Err(MeshReadError::BadJson { .. })), "{broken:?}");
}

#[test]
fn gltf_1_is_called_by_its_version() {
    let old = json!({"asset": {"version": "1.0"}, "meshes": {"a": {}}, "scenes": {"s": {"nodes": ["n"]}}});
    for document in [old.clone(), json!({"meshes": {"a": {}}, "scenes": {"s": {"nodes": ["n"]}}})] {
        let refused = read_glb(document.to_string().as_bytes());
        assert_eq!(refused, Err(MeshReadError::Version { version: "1.0".into() }));
    }
    let reason = read_glb(old.to_string().as_bytes()).unwrap_err().reason();
    assert!(reason.what.contains("glTF 1.0") && reason.remedy.contains("gltf-pipeline"), "{reason:?}");
}

/// [`glb_with`] with accessors 3 and following for `more` data, each with its component type and type.
fn glb_with_data(more: &[(u32, &str, Vec<u8>)], change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let mut binary = Vec::new();
    let mut file = glb_with(|document| {
        for (component, shape, bytes) in more {
            let size = if *component == 5126 { 4 } else { 1 };
            let elements = match *shape {
                "VEC3" => 3,
                "VEC4" => 4,
                _ => 16,
            };
            let view = document["bufferViews"].as_array().unwrap().len();
            let at = 80 + binary.len();
            let count = bytes.len() / size / elements;
            document["bufferViews"]
                .as_array_mut()
                .unwrap()
                .push(json!({"buffer": 0, "byteOffset": at, "byteLength": bytes.len()}));
            document["accessors"]
                .as_array_mut()
                .unwrap()
                .push(json!({"bufferView": view, "componentType": component, "count": count, "type": shape}));
            binary.extend_from_slice(bytes);
        }
        document["buffers"][0]["byteLength"] = json!(80 + binary.len());
        change(document);
    });
    let chunk = file.len() - 80 - 8;
    file.extend_from_slice(&binary);
    let length = file.len() as u32;
    file[8..12].copy_from_slice(&length.to_le_bytes());
    file[chunk..chunk + 4].copy_from_slice(&(80 + binary.len() as u32).to_le_bytes());
    file
}

/// A part of several metres, whose numbers would be taken for mm without the setting.
fn read_large(bytes: &[u8]) -> Result<PartReading, MeshReadError> {
    let options = MeshOptions::default().with_unit(mesh::LengthUnit::Metre);
    mesh::read(bytes, MeshFormat::Glb, &options, &BTreeMap::new())
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// The corners of the part's box in metres, in the file's axes.
fn bounds(part: &PartReading) -> [[f64; 3]; 2] {
    let (min, max) = part.shape.mesh().unwrap().bounds();
    // Here z is up, in the file y.
    [[min.x, min.z, -max.y], [max.x, max.z, -min.y]].map(|corner| corner.map(|value| value / 1000.0))
}

fn are_near(found: [[f64; 3]; 2], expected: [[f64; 3]; 2]) -> bool {
    found.iter().flatten().zip(expected.iter().flatten()).all(|(one, other)| (one - other).abs() < 1e-6)
}

#[test]
fn morph_targets_are_applied_by_their_weights() {
    let morphed = |mesh: Value, node: Value, target: Value| {
        read_with(|document| {
            document["meshes"][0]["primitives"][0]["targets"] = json!([target, {"POSITION": 0}]);
            if !mesh.is_null() {
                document["meshes"][0]["weights"] = mesh;
            }
            if !node.is_null() {
                document["nodes"][0]["weights"] = node;
            }
        })
    };
    // The first target moves everything by 1 m along z, the second one makes the triangle larger.
    let up = json!({"POSITION": 1});
    for (mesh, node, expected) in [
        (Value::Null, Value::Null, [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]),
        (json!([0, 0]), Value::Null, [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]),
        (json!([0.5, 0]), Value::Null, [[0.0, 0.0, 0.5], [1.0, 1.0, 0.5]]),
        (json!([0.5, 0]), json!([0, 1]), [[0.0, 0.0, 0.0], [2.0, 2.0, 0.0]]),
        (json!([0, 0]), json!([-1, -0.5]), [[0.0, 0.0, -1.0], [0.5, 0.5, -1.0]]),
    ] {
        let part = morphed(mesh.clone(), node, up.clone()).unwrap();
        assert!(are_near(bounds(&part), expected), "{mesh}: {:?}", bounds(&part));
    }
    let found = |weight: f64, target: Value| morphed(json!([weight, 0]), Value::Null, target).unwrap().facts;
    assert_eq!(found(0.0, up.clone()).skipped, ["1 x set of morph targets"]);
    assert_eq!(found(0.5, up.clone()).normals, NormalsFound::None);
    assert_ne!(found(0.5, json!({"POSITION": 1, "NORMAL": 1})).normals, NormalsFound::None);
    // A target that moves nothing may have no data.
    let still = read_with(|document| {
        let zeros = json!({"componentType": 5126, "count": 3, "type": "VEC3"});
        let accessors = document["accessors"].as_array_mut().unwrap();
        accessors.push(zeros);
        let number = accessors.len() - 1;
        document["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": number}]);
        document["meshes"][0]["weights"] = json!([1]);
    });
    assert!(are_near(bounds(&still.unwrap()), [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]));
    let short = read_with(|document| {
        document["accessors"][1]["count"] = json!(2);
        document["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 1}]);
        document["meshes"][0]["weights"] = json!([1]);
    });
    assert!(matches!(short, Err(MeshReadError::WrongData { .. })), "{short:?}");
}

#[test]
fn instances_are_read_with_their_transforms() {
    let half = 0.5f32.sqrt();
    let data = [
        (5126, "VEC3", floats(&[1.0, 0.0, 0.0, 0.0, 0.0, 5.0])),
        // The second instance is turned from x to y.
        (5126, "VEC4", floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half])),
        (5126, "VEC3", floats(&[2.0, 2.0, 2.0, 3.0, 1.0, 1.0])),
    ];
    let instanced = |attributes: Value| {
        let bytes = glb_with_data(&data, |document| {
            let extension = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
            document["nodes"][0]["extensions"] = extension;
            document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
        });
        read_large(&bytes)
    };
    let part = instanced(json!({"TRANSLATION": 3, "ROTATION": 4, "SCALE": 5})).unwrap();
    assert_eq!(part.facts.triangles, 2);
    // The first has its legs from (1, 0, 0) to (3, 2, 0), the second from (0, 0, 5) to (-1, 3, 5).
    assert!(are_near(bounds(&part), [[-1.0, 0.0, 0.0], [3.0, 3.0, 5.0]]), "{:?}", bounds(&part));
    assert!(is_near(area(&part), [0.0, -3.5, 0.0]), "{}", area(&part));
    let moved = instanced(json!({"TRANSLATION": 3})).unwrap();
    assert!(are_near(bounds(&moved), [[0.0, 0.0, 0.0], [2.0, 1.0, 5.0]]), "{:?}", bounds(&moved));
    let unequal = instanced(json!({"TRANSLATION": 3, "SCALE": 0}));
    assert!(matches!(unequal, Err(MeshReadError::WrongData { .. })), "{unequal:?}");
    let missing = instanced(json!({"TRANSLATION": 99}));
    assert!(matches!(missing, Err(MeshReadError::BrokenReference { .. })), "{missing:?}");
}

#[test]
fn joints_place_a_mesh_with_a_skin_and_its_node_does_not() {
    let inverse = |x: f32| [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, 0.0, 0.0, 1.0];
    let skinned = |change: &dyn Fn(&mut Value)| {
        let data = [
            (5121, "VEC4", vec![0, 1, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]),
            (5126, "VEC4", floats(&[0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])),
            (5126, "MAT4", floats(&[inverse(0.0), inverse(-10.0)].concat())),
        ];
        let bytes = glb_with_data(&data, |document| {
            document["meshes"][0]["primitives"][0]["attributes"] =
                json!({"POSITION": 0, "JOINTS_0": 3, "WEIGHTS_0": 4});
            document["skins"] = json!([{"joints": [1, 3], "inverseBindMatrices": 5}]);
            document["nodes"] = json!([
                {"mesh": 0, "skin": 0, "translation": [100, 100, 100]},
                {"scale": [2, 2, 2]},
                {"children": [3], "translation": [0, 0, 4]},
                {"translation": [10, 6, 0]},
            ]);
            document["scenes"] = json!([{"nodes": [0, 1, 2]}]);
            change(document);
        });
        read_large(&bytes)
    };
    // (0, 0, 0) goes halfway to (0, 6, 4), (1, 0, 0) to (2, 0, 0), and (0, 1, 0) to (0, 7, 4).
    let part = skinned(&|_| {}).unwrap();
    assert!(are_near(bounds(&part), [[0.0, 0.0, 0.0], [2.0, 7.0, 4.0]]), "{:?}", bounds(&part));
    let first = part.shape.mesh().unwrap().positions()[0] / 1000.0;
    assert!(is_near(first.coords, [0.0, -2.0, 3.0]), "{first}");
    let refused = skinned(&|document| document["skins"][0]["joints"] = json!([1, 99]));
    assert!(matches!(refused, Err(MeshReadError::WrongData { .. })), "{refused:?}");
    let refused = skinned(&|document| document["skins"][0]["joints"] = json!([1]));
    assert!(matches!(refused, Err(MeshReadError::BrokenReference { kind: "joint", .. })), "{refused:?}");
    let refused = skinned(&|document| document["skins"] = json!([]));
    assert!(matches!(refused, Err(MeshReadError::BrokenReference { kind: "skin", .. })), "{refused:?}");
}

#[test]
fn hidden_objects_are_left_out_with_a_notice() {
    let read = |top: bool, below: bool| {
        read_with(|document| {
            let extension = |visible: bool| json!({"KHR_node_visibility": {"visible": visible}});
            document["nodes"] = json!([
                {"mesh": 0},
                {"children": [2], "translation": [5, 0, 0], "extensions": extension(top)},
                {"mesh": 0, "extensions": extension(below)},
            ]);
            document["scenes"] = json!([{"nodes": [0, 1]}]);
            document["extensionsRequired"] = json!(["KHR_node_visibility"]);
        })
        .unwrap()
        .facts
    };
    assert_eq!(read(true, true).triangles, 2);
    for (top, below) in [(false, true), (true, false), (false, false)] {
        let facts = read(top, below);
        assert_eq!((facts.triangles, &facts.skipped[..]), (1, &["1 x hidden object".to_owned()][..]));
        assert!(facts.notices.iter().any(|notice| notice.code == "part-hidden"));
    }
}
