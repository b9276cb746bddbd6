//! Real exports, read through the public API: every producer, every part, true sizes, and damaged files.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests may panic")]

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use isomark::formats::mesh::{
    self, EmptyCause, LengthUnit, MeshFormat, MeshOptions, MeshReadError, NormalsFound, PartReading, UpAxis,
};
use isomark::reason::Severity;

use LengthUnit::{Metre, Millimetre};
use NormalsFound::{FacetsOnly, Smooth};
use UpAxis::{Y, Z};

fn path_of(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parts").join(name)
}

fn read_with(name: &str, options: &MeshOptions) -> Result<PartReading, MeshReadError> {
    let path = path_of(name);
    let bytes = std::fs::read(&path).unwrap();
    let format = MeshFormat::from_name(name).unwrap();
    mesh::read(&bytes, format, options, &siblings_of(&path, &bytes, format))
}

/// The files beside the part that are needed to read it.
fn siblings_of(path: &Path, bytes: &[u8], format: MeshFormat) -> BTreeMap<String, Vec<u8>> {
    let named = mesh::named_files(bytes, format).map(|named| named.buffers).unwrap_or_default();
    let beside = |name: &String| std::fs::read(path.with_file_name(name)).unwrap();
    named.into_iter().map(|buffer| (buffer.name.clone(), beside(&buffer.name))).collect()
}

fn read(name: &str) -> PartReading {
    read_with(name, &MeshOptions::default()).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Enclosed volume, mm³; positive if the triangles are counter-clockwise when seen from outside.
fn volume(part: &PartReading) -> f64 {
    let of = |corners| {
        let [a, b, c] = part.shape.mesh().unwrap().corners(corners);
        a.coords.dot(&b.coords.cross(&c.coords)) / 6.0
    };
    part.shape.mesh().unwrap().triangles().iter().map(|&corners| of(corners)).sum()
}

/// True extents and volume, mm and mm³, from `truth.json`.
fn truth(part: &str) -> ([f64; 3], [f64; 3], f64) {
    let text = std::fs::read_to_string(path_of(&format!("{part}/truth.json"))).unwrap();
    let truth: serde_json::Value = serde_json::from_str(&text).unwrap();
    let corner = |at: usize| [0, 1, 2].map(|axis| truth["bbox"][at][axis].as_f64().unwrap());
    (corner(0), corner(1), truth["volume_mesh_0p01_mm3"].as_f64().unwrap())
}

/// A sample with its expected unit, axis, number of triangles and normals.
type Sample = (&'static str, LengthUnit, UpAxis, usize, NormalsFound);

/// Exports of the CAD parts that keep the position of the design.
const CAD_SAMPLES: [Sample; 47] = [
    ("assembly/bl34-from-glb.glb", Metre, Y, 964, Smooth),
    ("assembly/bl34-from-glb.obj", Metre, Y, 964, Smooth),
    ("assembly/bl52-from-glb.glb", Metre, Y, 964, Smooth),
    ("assembly/bl52-from-obj.glb", Millimetre, Z, 964, FacetsOnly),
    ("assembly/bl52-from-obj.obj", Millimetre, Z, 964, FacetsOnly),
    ("assembly/build123d.glb", Metre, Y, 1228, Smooth),
    ("assembly/fc020-coarse.glb", Metre, Y, 780, Smooth),
    ("assembly/fc020-fine.glb", Metre, Y, 3020, Smooth),
    ("assembly/fc020-gui-flat.glb", Metre, Y, 964, Smooth),
    ("assembly/fc020-gui-mesh.obj", Millimetre, Z, 964, FacetsOnly),
    ("assembly/fc020-gui.glb", Metre, Y, 964, Smooth),
    ("assembly/fc020-gui.gltf", Metre, Y, 964, Smooth),
    ("assembly/occ8-coarse.glb", Metre, Z, 780, Smooth),
    ("assembly/occ8-fine-merged.glb", Metre, Z, 1820, Smooth),
    ("can/bl34-from-glb.glb", Metre, Y, 408, Smooth),
    ("can/bl34-from-glb.obj", Metre, Y, 408, Smooth),
    ("can/bl42-from-glb.glb", Metre, Y, 408, Smooth),
    ("can/bl42-from-glb.obj", Metre, Y, 408, Smooth),
    ("can/bl52-from-glb.glb", Metre, Y, 408, Smooth),
    ("can/bl52-from-obj.glb", Millimetre, Z, 582, FacetsOnly),
    ("can/bl52-from-obj.obj", Millimetre, Z, 582, FacetsOnly),
    ("can/build123d.glb", Metre, Y, 332, Smooth),
    ("can/fc020-arch.obj", Millimetre, Z, 140, FacetsOnly),
    ("can/fc020-coarse-mesh.obj", Millimetre, Z, 582, FacetsOnly),
    ("can/fc020-coarse.glb", Metre, Y, 204, Smooth),
    ("can/fc020-fine-mesh.obj", Millimetre, Z, 1184, FacetsOnly),
    ("can/fc020-fine.glb", Metre, Y, 1184, Smooth),
    ("can/fc020-gui.glb", Metre, Y, 408, Smooth),
    ("can/occ8-coarse.glb", Metre, Z, 204, Smooth),
    ("can/occ8-fine-merged.glb", Metre, Z, 582, Smooth),
    ("mandarin/bl52-from-glb.glb", Metre, Y, 6736, Smooth),
    ("mandarin/bl52-from-obj.glb", Millimetre, Z, 1116, FacetsOnly),
    ("mandarin/build123d.glb", Metre, Y, 592, Smooth),
    ("mandarin/fc020-arch.obj", Millimetre, Z, 292, FacetsOnly),
    ("mandarin/fc020-coarse-mesh.obj", Millimetre, Z, 1116, FacetsOnly),
    ("mandarin/fc020-coarse.glb", Metre, Y, 1116, Smooth),
    ("mandarin/occ8-coarse.glb", Metre, Z, 1322, Smooth),
    ("mouse/bl34-from-glb.glb", Metre, Y, 1744, Smooth),
    ("mouse/bl42-from-glb.glb", Metre, Y, 1744, Smooth),
    ("mouse/bl52-from-obj.glb", Millimetre, Z, 488, FacetsOnly),
    ("mouse/build123d.glb", Metre, Y, 926, Smooth),
    ("mouse/fc020-arch.obj", Millimetre, Z, 174, FacetsOnly),
    ("mouse/fc020-coarse-mesh.obj", Millimetre, Z, 488, FacetsOnly),
    ("mouse/fc020-coarse.glb", Metre, Y, 488, Smooth),
    ("mouse/fc020-gui.glb", Metre, Y, 1744, Smooth),
    ("mouse/occ8-coarse.glb", Metre, Z, 826, Smooth),
    ("can/build123d-cm.gltf", Metre, Y, 204, Smooth),
];

/// Chord tolerance of the coarsest tessellation (Arch export: about 1 mm), mm.
const COARSEST_CHORD: f64 = 1.1;

#[test]
fn cad_parts_are_read_at_their_true_position_and_size() {
    for (name, unit, up, triangles, normals) in CAD_SAMPLES {
        let part = read(name);
        let facts = &part.facts;
        assert_eq!((facts.unit.value, facts.up.value), (unit, up), "{name}");
        assert_eq!((facts.triangles, facts.normals), (triangles, normals), "{name}");
        assert_eq!(part.shape.mesh().unwrap().normals().is_empty(), normals == FacetsOnly, "{name}");
        assert!(!facts.unit.why.is_empty() && !facts.up.why.is_empty(), "{name}");
        assert!(facts.producer.is_some(), "{name}");

        // This can was exported with unit CM, which no reader can know, so it is ten times too large.
        let scale = if name.ends_with("-cm.gltf") { 10.0 } else { 1.0 };
        let (true_min, true_max, true_volume) = truth(name.split('/').next().unwrap());
        let (min, max) = part.shape.mesh().unwrap().bounds();
        for axis in 0..3 {
            let off =
                (min[axis] - scale * true_min[axis]).abs().max((max[axis] - scale * true_max[axis]).abs());
            assert!(off < COARSEST_CHORD * scale, "{name}: axis {axis} is off by {off} mm");
        }
        // Chords reduce the volume by a few per cent; triangles with the wrong orientation would change the sign.
        let ratio = volume(&part) / (true_volume * scale.powi(3));
        assert!((0.9..1.01).contains(&ratio), "{name}: {ratio} of the true volume");
    }
}

/// A block from (0, 0, 0) to (60, 40, 25) mm in CAD, turned by 30° about an axis and moved by (5, 0, 10) mm then.
fn placed_block(axis: Option<usize>) -> ([f64; 3], [f64; 3]) {
    let (sine, cosine) = 30f64.to_radians().sin_cos();
    let corners = [[0.0, 60.0], [0.0, 40.0], [0.0, 25.0]];
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for corner in 0..8 {
        let [x, y, z] = [0, 1, 2].map(|of: usize| corners[of][corner >> of & 1]);
        let [x, y, z] = match axis {
            Some(1) => [cosine * x + sine * z, y, cosine * z - sine * x],
            Some(2) => [cosine * x - sine * y, sine * x + cosine * y, z],
            _ => [x, y, z],
        };
        for (of, value) in [x + 5.0, y, z + 10.0].into_iter().enumerate() {
            (min[of], max[of]) = (min[of].min(value), max[of].max(value));
        }
    }
    (min, max)
}

#[test]
fn glb_files_of_cadquery_and_build123d_stand_where_cad_has_the_part() {
    use Severity::{Note, Warning};
    for (name, (min, max), severity) in [
        ("cadquery.glb", ([0.0; 3], [60.0, 40.0, 25.0]), Note),
        ("cadquery-added.glb", placed_block(Some(2)), Note),
        ("cadquery-placed.glb", placed_block(Some(2)), Warning),
        ("build123d-moved.glb", placed_block(None), Note),
        ("build123d-placed.glb", placed_block(Some(2)), Warning),
        ("build123d-tilted.glb", placed_block(Some(1)), Warning),
    ] {
        let part = read(&format!("upright/{name}"));
        let mesh = part.shape.mesh().unwrap();
        let bounds = mesh.bounds();
        for axis in 0..3 {
            let off = (bounds.0[axis] - min[axis]).abs().max((bounds.1[axis] - max[axis]).abs());
            assert!(off < 1e-4, "{name}: {bounds:?} instead of {min:?} and {max:?}");
        }
        // Each normal is that of its facet.
        for corners in mesh.triangles() {
            let [a, b, c] = mesh.corners(*corners);
            let plane = (b - a).cross(&(c - a)).normalize();
            corners.iter().for_each(|&at| assert!(plane.dot(&mesh.normals()[at as usize]) > 0.999, "{name}"));
        }
        let notice = part.facts.notices.iter().find(|notice| notice.code == "axis-assumed").unwrap();
        assert_eq!(notice.severity, severity, "{name}: {}", notice.message);
    }
    // The settings decide: the part as it is in the file.
    let mut options = MeshOptions::default();
    options.up = Some(Z);
    let lying = read_with("upright/cadquery.glb", &options).unwrap().facts.size;
    assert!((lying[1] - 25.0).abs() < 1e-4 && (lying[2] - 40.0).abs() < 1e-4, "{lying:?}");
}

#[test]
fn guesses_and_contradictions_of_the_standard_are_warnings() {
    let severities = |name: &str| {
        let notices = read(name).facts.notices;
        ["unit-assumed", "axis-assumed"]
            .map(|code| notices.iter().find(|notice| notice.code == code).unwrap().severity)
    };
    use Severity::{Note, Warning};
    assert_eq!(severities("can/fc020-gui.glb"), [Note, Note]);
    assert_eq!(severities("can/build123d.glb"), [Note, Note]);
    assert_eq!(severities("can/occ8-coarse.glb"), [Note, Warning]);
    assert_eq!(severities("can/bl52-from-glb.glb"), [Note, Note]);
    assert_eq!(severities("can/bl52-from-obj.glb"), [Warning, Warning]);
    assert_eq!(severities("can/fc020-arch.obj"), [Note, Note]);
    assert_eq!(severities("can/bl42-from-glb.obj"), [Note, Note]);
    assert_eq!(severities("vessel/bl52-native-zup-mm.obj"), [Warning, Warning]);
    assert_eq!(severities("reference/cylinder_coarse.obj"), [Warning, Warning]);
}

#[test]
fn estimated_normals_are_reported() {
    let has_note =
        |name: &str| read(name).facts.notices.iter().any(|notice| notice.code == "normals-estimated");
    assert!(has_note("can/fc020-arch.obj") && has_note("reference/cylinder_coarse.obj"));
    assert!(!has_note("can/fc020-coarse.glb"));
}

#[test]
fn the_vessel_is_read_with_its_scale_rotation_and_mirrored_plate() {
    // glTF has no modifiers applied and contains the hidden plate, OBJ the other way round.
    let expected = [
        ("bl34-native.glb", Metre, Y, 358, [165.80, 106.00, 115.20]),
        ("bl34-native.gltf", Metre, Y, 358, [165.80, 106.00, 115.20]),
        ("bl42-native.glb", Metre, Y, 358, [165.80, 106.00, 115.20]),
        ("bl52-native.glb", Metre, Y, 358, [165.80, 106.00, 115.20]),
        ("bl52-native.gltf", Metre, Y, 358, [165.80, 106.00, 115.20]),
        ("bl34-native-apply.glb", Metre, Y, 1104, [165.80, 104.90, 115.20]),
        ("bl52-native-apply.glb", Metre, Y, 1104, [165.80, 104.90, 115.20]),
        ("bl34-native-mmscene.glb", Millimetre, Y, 358, [150.82, 91.02, 115.20]),
        ("bl52-native-mmscene.glb", Millimetre, Y, 358, [150.82, 91.02, 115.20]),
        ("bl34-native.obj", Metre, Y, 1072, [101.60, 79.79, 115.08]),
        ("bl42-native.obj", Metre, Y, 1072, [101.60, 79.79, 115.08]),
        ("bl52-native.obj", Metre, Y, 1072, [101.60, 79.79, 115.08]),
        ("bl34-native-mmscene.obj", Millimetre, Y, 1072, [101.60, 79.79, 115.08]),
        ("bl52-native-mmscene.obj", Millimetre, Y, 1072, [101.60, 79.79, 115.08]),
        ("bl52-native-zup-mm.obj", Millimetre, Z, 1072, [101.60, 79.79, 115.08]),
    ];
    for (name, unit, up, triangles, size) in expected {
        let part = read(&format!("vessel/{name}"));
        let facts = &part.facts;
        assert_eq!((facts.unit.value, facts.up.value, facts.triangles), (unit, up, triangles), "{name}");
        let off = (0..3).map(|axis| (facts.size[axis] - size[axis]).abs()).fold(0.0, f64::max);
        assert!(off < 0.01, "{name}: {:?}", facts.size);
        assert_eq!(facts.materials, ["Ceramic", "MARK"], "{name}");
        let has_hidden = facts.bodies.iter().any(|body| body == "Hidden plate");
        assert_eq!(has_hidden, !name.ends_with(".obj"), "{name}");
        assert!(volume(&part) > 0.0, "{name}");
    }
}

#[test]
fn a_mirrored_plate_faces_the_same_way_as_in_blender() {
    // In Blender's OBJ, with mirrors applied, both plates face 30° left of +x, 56 mm from the vessel's axis.
    let facing = nalgebra::Vector3::new(30f64.to_radians().cos(), 30f64.to_radians().sin(), 0.0);
    for name in ["vessel/bl52-native-apply.glb", "vessel/bl34-native.glb", "vessel/bl52-native.obj"] {
        let part = read(name);
        let plates = part.shape.mesh().unwrap().triangles().iter().filter_map(|&corners| {
            let [a, b, c] = part.shape.mesh().unwrap().corners(corners);
            let from_axis = (a.coords - nalgebra::Vector3::new(100.0, 50.0, a.z)).dot(&facing).abs();
            // The hidden plate of the glTF files is on the ground.
            (from_axis > 49.9 && a.z > 20.0).then(|| (b - a).cross(&(c - a)).normalize())
        });
        let normals: Vec<_> = plates.collect();
        assert_eq!(normals.len(), 64, "{name}");
        assert!(normals.iter().all(|normal| (normal - facing).norm() < 1e-3), "{name}");
    }
}

#[test]
fn bodies_and_materials_keep_their_names() {
    let names = |name: &str| read(name).facts.bodies;
    assert_eq!(names("assembly/fc020-gui.glb"), ["Base", "Badge", "Bolt", "Bolt001"]);
    assert_eq!(names("assembly/fc020-gui-arch.obj"), ["Base", "Badge", "Bolt", "Bolt001"]);
    assert_eq!(names("assembly/fc020-gui-mesh.obj"), ["Base", "Badge", "Bolt", "Bolt001"]);
    assert_eq!(names("assembly/bl34-from-glb.obj"), ["Base", "Badge", "Bolt", "Bolt001"]);
    assert_eq!(names("can/fc020-coarse-mesh.obj"), [""; 0]);
    assert_eq!(names("can/fc020-arch.obj"), ["Solid"]);
    let materials = read("assembly/fc020-gui-badge.glb").facts.materials;
    assert_eq!(materials, ["mat_0", "mat_1"]);
}

#[test]
fn placements_that_an_export_lost_are_not_guessed() {
    // The badge alone is at the origin; the Arch export has the container's placement, the others do not.
    let badge = read("assembly/fc020-gui-badge.glb");
    assert!(
        (badge.facts.size[0] - 40.0).abs() < 1e-3 && badge.shape.mesh().unwrap().bounds().0.z.abs() < 1e-3
    );
    let arch = read("assembly/fc020-gui-arch.obj").facts.size;
    assert!((arch[0] - 88.406).abs() < 1e-2 && (arch[1] - 67.193).abs() < 1e-2, "{arch:?}");
}

#[test]
fn reference_surfaces_without_producer_are_millimetres_with_z_up() {
    for (name, size) in [("cylinder", [56.0, 60.0]), ("sphere", [54.0, 54.0]), ("mandarin", [54.0, 54.0])] {
        let facts = read(&format!("reference/{name}_coarse.obj")).facts;
        assert_eq!((facts.unit.value, facts.up.value, facts.normals), (Millimetre, Z, NormalsFound::None));
        assert!((facts.size[0] - size[0]).abs() < 1e-6 && (facts.size[1] - size[1]).abs() < 1e-6, "{name}");
    }
}

#[test]
fn settings_override_the_file() {
    let options = MeshOptions::default().with_unit(Metre).with_up(Y);
    let on_its_side = read_with("assembly/occ8-coarse.glb", &options).unwrap();
    assert!((on_its_side.facts.size[1] - 35.501).abs() < 1e-3, "{:?}", on_its_side.facts.size);
    assert_eq!(on_its_side.facts.up.why, "the settings say so");
    let options = MeshOptions::default().with_unit(LengthUnit::Centimetre);
    let inflated = read_with("can/fc020-coarse-mesh.obj", &options).unwrap();
    assert!((inflated.facts.size[2] - 1150.0).abs() < 1e-6);
}

#[test]
fn a_part_in_decimetres_is_read_as_metres_with_a_notice() {
    // The numbers are decimetres, but glTF has metres.
    let facts = read("can/build123d-cm.gltf").facts;
    assert!((facts.size[2] - 1150.0).abs() < 1e-3);
    let notice = facts.notices.iter().find(|notice| notice.code == "size-unconfirmed").unwrap();
    assert_eq!(notice.severity, Severity::Note);
    assert!(notice.message.contains("1150.0 mm") && notice.message.contains("unit MM"), "{}", notice.message);
    let options = MeshOptions::default().with_unit(LengthUnit::Decimetre);
    assert!((read_with("can/build123d-cm.gltf", &options).unwrap().facts.size[2] - 115.0).abs() < 1e-4);
    assert!(read("can/build123d.glb").facts.notices.iter().all(|notice| notice.code != "size-unconfirmed"));
}

#[test]
fn a_container_without_its_bodies_is_refused_with_its_cause() {
    let refused = read_with("assembly/fc020-gui-arch-part.obj", &MeshOptions::default()).unwrap_err();
    assert_eq!(refused, MeshReadError::NoTriangles { cause: EmptyCause::ArchContainer });
    let reason = refused.reason().in_file("fc020-gui-arch-part.obj");
    assert_eq!(reason.code, "mesh-empty");
    assert!(reason.remedy.contains("Select the bodies themselves"), "{reason}");
}

#[test]
fn a_gltf_lists_the_files_it_needs() {
    for (name, sibling) in
        [("can/build123d-cm", "build123d-cm.bin"), ("vessel/bl34-native", "bl34-native.bin")]
    {
        let bytes = std::fs::read(path_of(&format!("{name}.gltf"))).unwrap();
        let size = std::fs::metadata(path_of(&format!("{name}.gltf")).with_file_name(sibling)).unwrap().len();
        let named = mesh::Buffer { name: sibling.into(), bytes: size };
        assert_eq!(mesh::named_files(&bytes, MeshFormat::Gltf).unwrap().buffers, [named]);
        let alone = mesh::read(&bytes, MeshFormat::Gltf, &MeshOptions::default(), &BTreeMap::new());
        let missing = MeshReadError::BufferMissing { name: sibling.into(), kind: io::ErrorKind::NotFound };
        assert_eq!(alone, Err(missing));
    }
}

/// Triangles and enclosed volume of an OBJ text, with faces cut into fans: the volume is exact for any flat polygon.
fn fans(text: &str) -> (usize, f64) {
    let (mut vertices, mut count, mut volume) = (Vec::<nalgebra::Vector3<f64>>::new(), 0, 0.0);
    for line in text.lines() {
        let mut values = line.split_whitespace().skip(1);
        if line.starts_with("v ") {
            let coordinates = [0; 3].map(|_| values.next().unwrap().parse().unwrap());
            vertices.push(nalgebra::Vector3::from(coordinates));
        } else if line.starts_with("f ") {
            let index = |corner: &str| corner.split('/').next().unwrap().parse::<usize>().unwrap();
            let face: Vec<_> = values.map(|corner| vertices[index(corner) - 1]).collect();
            for rim in face[1..].windows(2) {
                volume += face[0].dot(&rim[0].cross(&rim[1])) / 6.0;
                count += 1;
            }
        }
    }
    (count, volume)
}

#[test]
fn all_triangles_of_obj_files_are_read() {
    for (name, ..) in CAD_SAMPLES.iter().filter(|(name, ..)| name.ends_with(".obj")) {
        let part = read(name);
        let (count, volume_of_fans) = fans(&std::fs::read_to_string(path_of(name)).unwrap());
        assert_eq!(part.facts.triangles, count, "{name}");
        let expected: f64 = volume_of_fans * part.facts.unit.value.in_mm().powi(3);
        assert!((volume(&part) / expected - 1.0).abs() < 1e-9, "{name}: {} and {expected}", volume(&part));
    }
}

/// Random damage, the same in every run: any result is accepted except a panic or an endless loop.
#[test]
fn damaged_files_are_read_or_refused_without_a_panic() {
    // xorshift64, G. Marsaglia, Xorshift RNGs, J. Stat. Softw. 8(14), 2003.
    let mut state = 0x9E37_79B9_7F4A_7C15u64;
    let mut random = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state % below as u64) as usize
    };
    let samples = [
        "assembly/fc020-gui-badge.glb",
        "vessel/bl52-native.glb",
        "can/build123d-cm.gltf",
        "vessel/bl52-native.gltf",
        "can/fc020-arch.obj",
        "can/bl34-from-glb.obj",
    ];
    let mut read_at_all = 0;
    for name in samples {
        let path = path_of(name);
        let original = std::fs::read(&path).unwrap();
        let format = MeshFormat::from_name(name).unwrap();
        let siblings = siblings_of(&path, &original, format);
        // Most bytes of a GLB are numbers; damage in its JSON has more effect.
        let json_end = original.windows(4).position(|four| four == b"BIN\0").unwrap_or(original.len());
        for _ in 0..1500 {
            let mut bytes = original.clone();
            for _ in 0..=random(3) {
                let reach = if random(4) == 0 { bytes.len() } else { json_end.min(bytes.len()) };
                let at = random(reach.max(1));
                match random(6) {
                    _ if bytes.is_empty() => {}
                    0 => bytes[at] ^= 1 << random(8),
                    1 => bytes[at] = b"0123456789-./{}[],\" \n\\#\0e"[random(25)],
                    2 => bytes.truncate(at),
                    3 => drop(bytes.drain(at..(at + random(40)).min(reach))),
                    4 => {
                        let copy = bytes[at..(at + random(40)).min(reach)].to_vec();
                        let to = random(reach.max(1));
                        bytes.splice(to..to, copy);
                    }
                    // A digit in front makes counts and indices large.
                    _ => bytes.insert(at, b'9'),
                }
            }
            // The buffer's name may be damaged, too, so the content is given under that name.
            let named = mesh::named_files(&bytes, format).map(|named| named.buffers).unwrap_or_default();
            let content = siblings.values().next().cloned().unwrap_or_default();
            let given = named.into_iter().map(|buffer| (buffer.name, content.clone())).collect();
            let outcome = mesh::read(&bytes, format, &MeshOptions::default(), &given);
            match outcome {
                Ok(part) => read_at_all += usize::from(part.facts.triangles > 0),
                Err(error) => assert!(!error.reason().remedy.is_empty()),
            }
        }
    }
    assert!(read_at_all > 500, "only {read_at_all} damaged files were readable");
}
