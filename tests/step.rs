//! STEP files as parts: what the laser meets is on the exact surfaces.
//!
//! `tests/data/parts/step` was written by OpenCASCADE from shapes with closed forms (`make.py`).

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test may fail loudly, its helpers too")]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use fs_err as fs;

use isomark::formats::mesh::{self, MeshFormat, MeshOptions, MeshReadError, PartReading, Shape, StepProblem};
use isomark::geometry::facing_part::FacingPart;
use isomark::geometry::fork::InTurn;
use isomark::geometry::height_field::{Grid, HeightField, Node};
use isomark::geometry::space::{Facing, View, ViewPoint};
use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
use nalgebra::{Point3, Vector3};

const PARTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/parts");

fn text(name: &str) -> String {
    fs::read_to_string(Path::new(PARTS).join(name)).unwrap()
}

fn read(bytes: &[u8]) -> Result<PartReading, MeshReadError> {
    mesh::read(bytes, MeshFormat::Step, &MeshOptions::default(), &BTreeMap::new())
}

fn part(name: &str) -> PartReading {
    read(text(name).as_bytes()).unwrap()
}

fn facing(reading: &PartReading, view: &View) -> FacingPart<'static> {
    let Shape::Solid(part) = &reading.shape else { panic!("a STEP file is a solid") };
    FacingPart::of_solid(&part.solid, &part.mesh, view, &InTurn)
}

fn sampled(reading: &PartReading, view: &View, steps: f64) -> HeightField {
    let part = facing(reading, view);
    part.sample(&Grid::over(&part.extents(), part.extents().size().max() / steps)).field
}

fn views() -> [View; 3] {
    let towards = |x: f64, y: f64, z: f64| Facing::towards(Vector3::new(x, y, z)).unwrap();
    [View::top(), View::new(towards(0.0, -1.0, 0.0), 0.0), View::new(towards(0.5, -0.8, 0.3), 0.7)]
}

/// The axes of the shapes of `make.py`: their origin and the direction of their axis.
fn axes() -> (Point3<f64>, Vector3<f64>) {
    (Point3::new(5.0, -3.0, 2.0), Vector3::new(0.3, 0.4, 1.2).normalize())
}

/// Distances from the origin of the axes, across and along the axis.
fn round(at: &Point3<f64>) -> (f64, f64) {
    let (origin, axis) = axes();
    let along = (at - origin).dot(&axis);
    ((at - origin - axis * along).norm(), along)
}

/// All nodes on the smooth surface, in the part frame, are where `misfit` is below 1e-8.
fn assert_on(name: &str, misfit: impl Fn(&Point3<f64>) -> f64) {
    let reading = part(name);
    for view in views() {
        let field = sampled(&reading, &view, 70.0);
        let (mut nodes, mut at_edges) = (0, 0);
        for (column, row, height) in field.surface_nodes() {
            let at = field.position(column, row);
            let at = view.part_point(Point3::new(at.x, at.y, height));
            // Two faces meet at an edge to within its chords.
            assert!(misfit(&at).abs() < 1e-3, "{name}: {at} is off by {}", misfit(&at));
            at_edges += usize::from(misfit(&at).abs() > 1e-8);
            nodes += 1;
        }
        assert!(nodes > 600 && at_edges <= 2, "{name}: {nodes} nodes, {at_edges} off");
    }
}

#[test]
fn heights_are_exact_on_all_kinds_of_surfaces_and_in_all_units() {
    for name in ["step/ball.step", "step/ball-inch.step", "step/ball-m.step"] {
        assert_on(name, |at| {
            let (across, along) = round(at);
            across.hypot(along) - 20.0
        });
    }
    for name in ["step/ring.step", "step/ring-spline.step"] {
        assert_on(name, |at| {
            let (across, along) = round(at);
            (across - 30.0).hypot(along) - 10.0
        });
    }
    assert_on("step/cone.step", |at| {
        let (across, along) = round(at);
        let side = (across - 20.0 * (1.0 - along / 40.0)) * 2.0 / 5f64.sqrt();
        if side.abs() < along.abs() { side } else { along }
    });
    assert_on("step/roll-inch.step", |at| {
        let side = at.x.hypot(at.z - 7.0) - 25.0;
        [side, at.y - 50.0, at.y + 50.0].into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap()
    });
    assert_on("step/egg.step", |at| (at.x / 30.0).powi(2) + (at.y.powi(2) + at.z.powi(2)) / 400.0 - 1.0);
    for (name, off) in [("step/barrel.step", -20.0), ("step/apple.step", 20.0)] {
        assert_on(name, |at| {
            let side = (at.x.hypot(at.y) - off).hypot(at.z) - 50.0;
            [side, at.z - 20.0, at.z + 20.0].into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap()
        });
    }
    assert_on("step/oval.step", |at| {
        let side = (at.x / 30.0).powi(2) + (at.z / 12.0).powi(2) - 1.0;
        [side, at.y, at.y - 60.0].into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap()
    });
}

/// The places of the surface that are nearest to an edge of a thin blade are on its other side.
#[test]
fn the_sides_of_a_thin_blade_are_read() {
    let reading = part("step/blade.step");
    assert!(reading.facts.notices.iter().all(|notice| notice.code != "step-face-unread"));
    let side = facing(&reading, &View::new(Facing::towards(Vector3::y()).unwrap(), 0.0));
    let surface = FittedSurface::of_part(&side, &FitOptions::default()).unwrap();
    // OpenCASCADE 7.6: where lines along Y meet the shape.
    for (x, y, height) in [
        (-8.0, 20.0, 5.216309036),
        (0.0, 20.0, 5.409828321),
        (8.0, 20.0, 3.771154297),
        (-8.0, 50.0, 4.713440837),
        (0.0, 50.0, 4.924935280),
        (8.0, 50.0, 3.238272067),
        (-5.0, 75.0, 4.545628308),
        (-14.0, 10.0, 4.218293127),
    ] {
        let found = surface.sampled_height(ViewPoint::new(x, y)).unwrap();
        assert!((found - height).abs() < 2e-3, "({x}, {y}): {found} mm for {height}");
    }
}

#[test]
fn the_outline_is_that_of_the_shape() {
    let (origin, axis) = axes();
    let (ball, ring) = (part("step/ball.step"), part("step/ring.step"));
    let field = sampled(&ball, &View::top(), 150.0);
    let along_axis = View::new(Facing::towards(axis).unwrap(), 0.0);
    let ring = sampled(&ring, &along_axis, 150.0);
    let (middle, turned) = (origin, along_axis.point(origin));
    let check = |field: &HeightField, middle: Point3<f64>, covered: &dyn Fn(f64) -> Option<bool>| {
        let (columns, _) = field.size();
        for (index, node) in field.nodes().iter().enumerate() {
            let at = field.position(index % columns, index / columns);
            let away = (at.coords() - middle.coords.xy()).norm();
            if let Some(covered) = covered(away) {
                assert_eq!(*node != Node::Empty, covered, "{at:?}");
            }
        }
    };
    let near = |away: f64, border: f64| (away - border).abs() < 0.002;
    check(&field, middle, &|away| (!near(away, 20.0)).then_some(away < 20.0));
    check(&ring, turned, &|away| {
        (!near(away, 20.0) && !near(away, 40.0)).then_some(away > 20.0 && away < 40.0)
    });
}

#[test]
fn products_in_products_are_placed() {
    let reading = part("step/table.step");
    assert_eq!(reading.facts.bodies, ["Roll", "Roll"]);
    let field = sampled(&reading, &View::top(), 200.0);
    let mut seen = [0, 0];
    for (column, row, height) in field.surface_nodes() {
        let at = field.position(column, row);
        let which = usize::from(at.x > 25.0);
        let across = at.x - 50.0 * which as f64;
        assert!(at.y > -20.01 && at.y < 20.01, "{at:?}");
        assert!((height - 3.0 - (100.0 - across * across).sqrt()).abs() < 1e-8, "{at:?}: {height}");
        seen[which] += 1;
    }
    assert!(seen.iter().all(|nodes| *nodes > 1000), "{seen:?}");
}

/// The can as the only component of an assembly, whose representation contains these items, with these further records.
fn can_in_assembly(items: &str, records: &str) -> PartReading {
    let can = text("can/part.step");
    let assembly = format!(
        "#80001=PRODUCT('ASM','ASM','',(#8));#80002=PRODUCT_DEFINITION_FORMATION('','',#80001);\
         #80003=PRODUCT_DEFINITION('design','',#80002,#9);#80004=PRODUCT_DEFINITION_SHAPE('','',#80003);\
         #80005=SHAPE_DEFINITION_REPRESENTATION(#80004,#80006);#80006=SHAPE_REPRESENTATION('',(#80010{items}),#219);\
         #80010=AXIS2_PLACEMENT_3D('',#80011,$,$);#80011=CARTESIAN_POINT('',(0.,0.,0.));\
         #80022=AXIS2_PLACEMENT_3D('',#80023,$,$);#80023=CARTESIAN_POINT('',(200.,10.,5.));\
         #80030=NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','','',#80003,#5,$);{records}"
    );
    let end = can.rfind("ENDSEC;").unwrap();
    read(format!("{}{assembly}{}", &can[..end], &can[end..]).as_bytes()).unwrap()
}

#[test]
fn a_component_that_its_assembly_maps_is_there_once() {
    let alone = part("can/part.step").facts;
    let bounds = |reading: &PartReading| reading.shape.mesh().unwrap().bounds();
    let (min, _) = bounds(&part("can/part.step"));
    let maps = "#80020=MAPPED_ITEM('',#80021,#80022);#80021=REPRESENTATION_MAP(#80010,#10);";
    let placed = "#80040=CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#80041,#80044);\
                  #80041=(REPRESENTATION_RELATIONSHIP('','',#10,#80006)\
                  REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#80042)SHAPE_REPRESENTATION_RELATIONSHIP());\
                  #80042=ITEM_DEFINED_TRANSFORMATION('','',#80010,#80022);\
                  #80044=PRODUCT_DEFINITION_SHAPE('','',#80030);";
    // The assembly in another one, which maps it in turn.
    let nested = "#81001=PRODUCT('TOP','TOP','',(#8));#81002=PRODUCT_DEFINITION_FORMATION('','',#81001);\
                  #81003=PRODUCT_DEFINITION('design','',#81002,#9);#81004=PRODUCT_DEFINITION_SHAPE('','',#81003);\
                  #81005=SHAPE_DEFINITION_REPRESENTATION(#81004,#81006);\
                  #81006=SHAPE_REPRESENTATION('',(#80010,#81020),#219);#81020=MAPPED_ITEM('',#81021,#80010);\
                  #81021=REPRESENTATION_MAP(#80010,#80006);\
                  #81030=NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','','',#81003,#80003,$);";
    for (items, records, shift) in [
        (",#80020", maps.to_owned(), [200.0, 10.0, 5.0]),
        (",#80020", format!("{maps}{nested}"), [200.0, 10.0, 5.0]),
        ("", placed.to_owned(), [200.0, 10.0, 5.0]),
        ("", String::new(), [0.0; 3]),
    ] {
        let reading = can_in_assembly(items, &records);
        assert_eq!(reading.facts.faces, alone.faces, "{records}");
        let moved = bounds(&reading).0 - min;
        assert!((moved - Vector3::from(shift)).norm() < 1e-6, "{records}: {moved}");
        let is_unplaced = reading.facts.notices.iter().any(|notice| notice.code == "step-placement-missing");
        assert_eq!(is_unplaced, records.is_empty(), "{records}");
    }
}

#[test]
fn a_unit_without_a_name_is_stated_as_converted() {
    let can = text("can/part.step");
    let micro = can.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.MICRO.,.METRE.)");
    assert_ne!(micro, can);
    let facts = read(micro.as_bytes()).unwrap().facts;
    assert!(facts.unit.why.contains("0.001 mm"), "{}", facts.unit.why);
    assert!((facts.size[2] * 1000.0 / part("can/part.step").facts.size[2] - 1.0).abs() < 1e-6);
}

#[test]
fn facts_give_unit_faces_and_bodies() {
    let facts = part("can/part.step").facts;
    assert_eq!((facts.unit.value.to_string(), facts.up.value.to_string()), ("mm".into(), "z".into()));
    let faces: Vec<(&str, usize)> = facts.faces.iter().map(|face| (face.kind.as_str(), face.count)).collect();
    assert_eq!(faces, [("cone", 2), ("cylinder", 1), ("plane", 2)]);
    let truth: serde_json::Value = serde_json::from_str(&text("assembly/truth.json")).unwrap();
    let reading = part("assembly/part.step");
    let size = |axis: usize| {
        let corner = |end: usize| truth["bbox"][end][axis].as_f64().unwrap();
        corner(1) - corner(0)
    };
    for axis in 0..3 {
        assert!((reading.facts.size[axis] - size(axis)).abs() < 1e-6, "{:?}", reading.facts.size);
    }
    let faces: usize = reading.facts.faces.iter().map(|face| face.count).sum();
    assert_eq!(
        (faces as u64, reading.facts.bodies.len() as u64),
        (truth["faces"].as_u64().unwrap(), truth["bodies"].as_u64().unwrap())
    );
    // The triangles for pictures are closed and have the volume of the CAD kernel, less their chords.
    for (name, volume) in [("can", 389_026.56), ("assembly", truth["volume_cad_mm3"].as_f64().unwrap())] {
        let reading = part(&format!("{name}/part.step"));
        let mesh = reading.shape.mesh().unwrap();
        let sum: f64 = mesh
            .triangles()
            .iter()
            .map(|corners| {
                let [a, b, c] = mesh.corners(*corners).map(|corner| corner.coords);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum();
        assert!((sum / volume - 1.0).abs() < 1e-3, "{name}: {sum}");
    }
}

#[test]
fn a_unit_of_the_settings_replaces_that_of_the_file() {
    let options = MeshOptions::default().with_unit(mesh::LengthUnit::Centimetre);
    let reading =
        mesh::read(text("can/part.step").as_bytes(), MeshFormat::Step, &options, &BTreeMap::new()).unwrap();
    assert!((reading.facts.size[2] - 1150.0).abs() < 1e-6, "{:?}", reading.facts.size);
    let field = sampled(&reading, &View::top(), 50.0);
    let top = field.surface_nodes().map(|(.., height)| height).fold(0.0, f64::max);
    assert!((top - 1150.0).abs() < 1e-6, "{top}");
    let upright = MeshOptions::default().with_up(mesh::UpAxis::Y);
    let lying =
        mesh::read(text("can/part.step").as_bytes(), MeshFormat::Step, &upright, &BTreeMap::new()).unwrap();
    let field = sampled(&lying, &View::top(), 50.0);
    let top = field.surface_nodes().map(|(.., height)| height).fold(0.0, f64::max);
    assert!((top - 33.0).abs() < 0.1, "{top}");
}

#[test]
fn the_cylinder_of_the_file_is_known_exactly() {
    let reading = part("step/roll-inch.step");
    let surface = FittedSurface::of_part(&facing(&reading, &View::top()), &FitOptions::default()).unwrap();
    assert!(surface.residual.p95 < 0.002, "{:?}", surface.residual);
    assert!(surface.uncertainties().is_empty() && surface.doubts().is_empty());
}

#[test]
fn a_face_that_is_not_read_matters_only_where_the_laser_sees_it() {
    let can = text("can/part.step");
    let (start, _) = can.match_indices("CONICAL_SURFACE").nth(1).unwrap();
    let end = start + can[start..].find(';').unwrap();
    let plane = can.find("PLANE('").unwrap();
    let number = can[..plane].rfind('#').unwrap();
    let basis = can[number..plane].split_whitespace().next().unwrap();
    let changed = format!("{}OFFSET_SURFACE('',{basis},1.,.F.){}", &can[..start], &can[end..]);
    let reading = read(changed.as_bytes()).unwrap();
    let warning = reading.facts.notices.iter().find(|notice| notice.code == "step-face-unread").unwrap();
    assert!(warning.message.contains("OFFSET_SURFACE"), "{}", warning.message);
    let seen = |z: f64| {
        let view = View::new(Facing::towards(Vector3::new(0.0, 0.0, z)).unwrap(), 0.0);
        facing(&reading, &view).faces().unwrap().unread().map(|face| face.id())
    };
    let sides = [seen(1.0), seen(-1.0)];
    assert!(sides[0].is_some() != sides[1].is_some(), "one chamfer is above, the other below: {sides:?}");
    let all = read(text("step/offset.step").as_bytes()).unwrap_err();
    let MeshReadError::Step(error) = &all else { panic!("{all}") };
    assert!(matches!(&error.problem, StepProblem::Unread { kind } if kind == "OFFSET_SURFACE"), "{error}");
    assert!(error.record.is_some() && error.line > 10, "{error}");
    assert!(error.to_string().contains("an OFFSET_SURFACE is not read"), "{error}");
    assert_eq!(all.reason().code, "step-face-unread");
}

/// The can with one text replaced by another.
fn changed(from: &str, to: &str) -> MeshReadError {
    let can = text("can/part.step");
    assert!(can.contains(from), "{from}");
    read(can.replacen(from, to, 1).as_bytes()).unwrap_err()
}

#[test]
fn damaged_files_give_a_reason_with_line_and_record() {
    let cases: &[(&str, &str, &str)] = &[
        ("#17 = ADVANCED_FACE('',(#18),#32,.T.)", "#17 = ADVANCED_FACE('',(#18),#99999,.T.)", "#99999"),
        ("#17 = ADVANCED_FACE('',(#18),#32,.T.)", "#17 = ADVANCED_FACE('',(#18),#17,.T.)", ""),
        ("CARTESIAN_POINT('',(33.,0.,3.))", "CARTESIAN_POINT('',(NaN,0.,3.))", "NaN"),
        ("CARTESIAN_POINT('',(33.,0.,3.))", "CARTESIAN_POINT('',(1.E999,0.,3.))", "finite"),
        ("CYLINDRICAL_SURFACE('',#33,33.)", "CYLINDRICAL_SURFACE('',#33,-33.)", "-33"),
        ("CYLINDRICAL_SURFACE('',#33,33.)", "CYLINDRICAL_SURFACE('',#33,'x')", "a number"),
        ("#16 = CLOSED_SHELL('',(#17", "#16 = CLOSED_SHELL('',(#16", "ADVANCED_FACE"),
        ("#24 = VERTEX_POINT", "#22 = VERTEX_POINT", "two records"),
        (".MILLI.,.METRE.", ".MILLI.,.FURLONG.", "FURLONG"),
        ("#13 = DIRECTION('',(0.,0.,1.))", "#13 = DIRECTION('',(0.,0.,0.))", ""),
        ("ISO-10303-21;", "solid can", "begins with"),
    ];
    for (from, to, word) in cases {
        let can = text("can/part.step");
        assert!(can.contains(from), "{from}");
        match read(can.replacen(from, to, 1).as_bytes()) {
            Ok(reading) => {
                // A face of a kind that is not read is named.
                assert!(word.is_empty(), "{to} was read");
                assert!(from.contains("#13") || !reading.facts.notices.is_empty(), "{to}");
            }
            Err(error) => {
                let reason = error.reason();
                assert!(reason.what.contains(word), "{to}: {}", reason.what);
                let is_step = !reason.what.contains("not a STEP file");
                assert_eq!(reason.place.line.is_some(), is_step, "{to}: {reason:?}");
                assert!(!reason.remedy.is_empty());
            }
        }
    }
    for other in ["hello", "hello\nworld\n", "  p 1 2 3\n"] {
        let found = other.trim().lines().next().unwrap();
        for refused in
            [read(other.as_bytes()).map(|_| ()), mesh::is_whole(other.as_bytes(), MeshFormat::Step)]
        {
            let error = refused.unwrap_err();
            assert!(!error.is_cut_short(), "{error}");
            assert_eq!(error.reason().what, format!("This is not a STEP file: it begins with \"{found}\"."));
            assert_eq!(error.reason().remedy, "Export the part as STEP again.");
        }
    }
    for begun in [&b""[..], b"ISO-103", b" ISO-10303-21;\n", b"/* begun", b"\0\0\0"] {
        assert!(mesh::is_whole(begun, MeshFormat::Step).unwrap_err().is_cut_short(), "{begun:?}");
    }
    let cut = text("can/part.step");
    for end in [1, 14, 300, 1000, 5000, cut.len() - 30] {
        let error = read(&cut.as_bytes()[..end]).unwrap_err();
        assert!(error.is_cut_short() || end < 20, "{end}: {error}");
    }
    let deep = format!("CARTESIAN_POINT('',{}33.{})", "(".repeat(100_000), ")".repeat(100_000));
    let error = changed("CARTESIAN_POINT('',(33.,0.,3.))", &deep);
    assert!(error.to_string().contains("nested"), "{error}");
}

#[test]
fn assemblies_that_contain_themselves_or_double_without_end_are_refused() {
    let table = text("step/table.step");
    let number = |kind: &str, nth: usize| -> String {
        let (place, _) = table.match_indices(kind).nth(nth).unwrap();
        let start = table[..place].rfind('#').unwrap();
        table[start..place]
            .split(|letter: char| !letter.is_ascii_digit() && letter != '#')
            .next()
            .unwrap()
            .to_owned()
    };
    let definitions: Vec<String> = (0..3).map(|nth| number("PRODUCT_DEFINITION('", nth)).collect();
    let record = |from: &str, to: &str, id: usize| {
        format!("#{id}=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','','',{from},{to},$);\n")
    };
    let with = |added: String| table.replacen("DATA;\n", &format!("DATA;\n{added}"), 1);
    let ring: String = definitions
        .iter()
        .enumerate()
        .map(|(index, from)| record(from, &definitions[(index + 1) % 3], 900_000 + index))
        .collect();
    let error = read(with(ring).as_bytes()).unwrap_err();
    assert!(error.to_string().contains("contains itself"), "{error}");
    // Each level contains the one below it twice: 2^30 rolls.
    let mut added = String::new();
    let mut below = definitions.iter().find(|id| !table.contains(&format!(",{id},$)"))).cloned().unwrap();
    for level in 0..30 {
        let own = format!("#{}", 910_000 + level);
        added += &format!("{own}=PRODUCT_DEFINITION('design','',#{},$);\n", 920_000);
        added += &record(&own, &below, 930_000 + 2 * level);
        added += &record(&own, &below, 930_001 + 2 * level);
        below = own;
    }
    added += "#920000=PRODUCT_DEFINITION_FORMATION('','',#920001);\n#920001=PRODUCT('x','x','',());\n";
    let error = read(with(added).as_bytes()).unwrap_err();
    assert!(error.to_string().contains("more than"), "{error}");
}

#[test]
fn any_damage_is_read_or_refused() {
    for name in ["step/ring-spline.step", "step/table.step", "step/egg.step"] {
        let whole = text(name).into_bytes();
        let mut state = 1u64;
        let mut next = |limit: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % limit
        };
        for _ in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..3 {
                let place = next(bytes.len());
                bytes[place] = b"0123456789.,#()'*$-E;"[next(21)];
            }
            match read(&bytes) {
                Ok(reading) => assert!(reading.facts.size.iter().all(|side| side.is_finite())),
                Err(error) => assert!(!error.reason().remedy.is_empty()),
            }
        }
    }
}

/// The heights that FreeCAD finds: the highest place where a line along z meets a face.
const FREECAD: &str = r#"
import json, os, Part
from FreeCAD import Vector
job = json.load(open(os.environ["ISOMARK_JOB"]))
shape = Part.Shape()
shape.read(job["part"])
box = shape.BoundBox
found = []
for x, y in job["places"]:
    line = Part.makeLine(Vector(x, y, box.ZMax + 10), Vector(x, y, box.ZMin - 10))
    # Each of the two ways misses some places: one those on edges, the other those on some faces with a seam.
    vertices = line.common(shape).Vertexes
    for face in shape.Faces:
        if face.BoundBox.intersect(line.BoundBox):
            vertices += line.section(face).Vertexes
    heights = [vertex.Point.z for vertex in vertices if abs(vertex.Point.z - box.Center.z) < box.ZLength / 2 + 1]
    found.append(max(heights) if heights else None)
json.dump(found, open(job["out"], "w"))
"#;

/// The name of FreeCAD without its window, if it is installed.
fn freecad() -> Option<&'static str> {
    let found = ["freecadcmd", "FreeCADCmd"].into_iter().find(|name| {
        // Not `--version`, which some builds of FreeCAD do not survive.
        let found = Command::new("sh").args(["-c", "command -v \"$0\"", name]).output();
        found.is_ok_and(|output| output.status.success())
    });
    if found.is_none() {
        assert!(std::env::var("CI").is_err(), "freecadcmd is required in CI");
        eprintln!("SKIPPED: freecadcmd is not installed");
    }
    found
}

/// Places on the surface that faces the laser, with their heights.
fn heights(reading: &PartReading, step: usize) -> Vec<[f64; 3]> {
    let field = sampled(reading, &View::top(), 40.0);
    let node = |(column, row, height): (usize, usize, f64)| {
        let at = field.position(column, row);
        [at.x, at.y, height]
    };
    field.surface_nodes().step_by(step).map(node).collect()
}

/// The heights that FreeCAD finds at these places of a file; `None` if it cannot read the file.
fn found_by_freecad(program: &str, part: &Path, places: &[[f64; 3]]) -> Option<Vec<Option<f64>>> {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let job = serde_json::json!({
        "part": part.to_string_lossy(),
        "places": places.iter().map(|[x, y, _]| [x, y]).collect::<Vec<_>>(),
        "out": path("found.json"),
    });
    fs::write(path("job.json"), job.to_string()).unwrap();
    fs::write(path("heights.py"), FREECAD).unwrap();
    let mut command = Command::new(program);
    command.arg(path("heights.py")).env("ISOMARK_JOB", path("job.json")).output().unwrap();
    serde_json::from_str(&fs::read_to_string(path("found.json")).ok()?).unwrap()
}

#[test]
fn heights_agree_with_those_of_freecad() {
    let Some(program) = freecad() else { return };
    for name in ["can/part.step", "assembly/part.step", "mandarin/part.step"] {
        let places = heights(&part(name), 29);
        let found = found_by_freecad(program, &Path::new(PARTS).join(name), &places).expect(name);
        assert!(found.len() > 20, "{name}: {}", found.len());
        for ([x, y, height], found) in places.iter().zip(found) {
            let found = found.unwrap_or_else(|| panic!("{name}: FreeCAD meets nothing at ({x}, {y})"));
            assert!((height - found).abs() < 1e-6, "{name} at ({x}, {y}): {height}, FreeCAD {found}");
        }
    }
}

/// The same for the files of any folder, to 0.001 mm: `ISOMARK_STEP_FOLDER=... cargo test --test step -- --ignored --nocapture`.
#[test]
#[ignore = "needs a folder of STEP files"]
fn heights_of_the_files_of_a_folder_agree_with_those_of_freecad() {
    let (Some(program), Ok(folder)) = (freecad(), std::env::var("ISOMARK_STEP_FOLDER")) else { return };
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let mut wrong = Vec::new();
    for file in files {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let reading = match read(&fs::read(&file).unwrap()) {
            Ok(reading) => reading,
            Err(error) => {
                println!("{name}: refused: {error}");
                continue;
            }
        };
        let places = heights(&reading, 7);
        let Some(found) = found_by_freecad(program, &file, &places) else {
            println!("{name}: FreeCAD cannot read it");
            continue;
        };
        // Where FreeCAD's own line misses, as along a seam, nothing can be compared.
        let both = places.iter().zip(found).filter_map(|(place, found)| Some((place, found?)));
        let (mut count, mut largest, mut where_it_is) = (0, 0.0f64, [0.0; 3]);
        for (place, found) in both {
            count += 1;
            if (place[2] - found).abs() > largest {
                (largest, where_it_is) = ((place[2] - found).abs(), *place);
            }
        }
        println!(
            "{name}: {count} of {} heights compared, at most {largest:.7} mm apart, at {where_it_is:?}",
            places.len()
        );
        if largest > 0.001 {
            wrong.push(name);
        }
    }
    assert_eq!(wrong, [""; 0]);
}

#[test]
fn components_in_other_files_are_named() {
    let missing =
        "#990001=DOCUMENT_FILE('LID.stp','','',$,'',$);#990002=DOCUMENT_FILE('manual.pdf','','',$,'',$);";
    let whole = text("step/table.step");
    let end = whole.rfind("ENDSEC;").unwrap();
    let reading = read(format!("{}{missing}{}", &whole[..end], &whole[end..]).as_bytes()).unwrap();
    let notices = &reading.facts.notices;
    let notice = notices.iter().find(|notice| notice.code == "step-files-missing").unwrap();
    assert!(notice.message.contains("LID.stp") && !notice.message.contains("manual"), "{}", notice.message);
    let head = whole.find("DATA;").unwrap() + "DATA;".len();
    let empty = read(format!("{}{missing}{}", &whole[..head], &whole[end..]).as_bytes()).unwrap_err();
    let message = empty.to_string();
    assert!(message.contains("LID.stp") && !message.contains("line"), "{message}");
}

/// A square of 4 mm around the origin.
const SQUARE: &str = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n0\nLWPOLYLINE\n8\nMARK\n90\n4\n\
    70\n1\n10\n-2\n20\n-2\n10\n2\n20\n-2\n10\n2\n20\n2\n10\n-2\n20\n2\n0\nENDSEC\n0\nEOF\n";

fn isomark(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isomark"));
    // A part converted in an earlier run would be in the cache of the user.
    let cache = folder.join("user-cache");
    command.args(arguments).current_dir(folder).env_remove("RUST_LOG");
    command.env("XDG_CACHE_HOME", &cache).env("LOCALAPPDATA", &cache);
    command
}

/// The exit code with the output and the messages.
fn ended(mut command: Command) -> (Option<i32>, String) {
    let output = command.output().unwrap();
    let texts = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8_lossy(&texts).into_owned())
}

#[test]
fn a_part_with_a_face_that_is_not_read_is_converted_where_the_settings_request_it() {
    let folder = tempfile::tempdir().unwrap();
    // OpenCASCADE wrote the offset of this surface with the wrong sign: its edges are 10 mm away.
    let wrong = text("step/offset.step");
    let cap = wrong.replace("('',#38,5.,", "('',#38,-5.,");
    fs::write(folder.path().join("wrong.step"), &wrong).unwrap();
    fs::write(folder.path().join("cap.step"), &cap).unwrap();
    fs::write(folder.path().join("named.step"), cap.replacen("ADVANCED_FACE(''", "ADVANCED_FACE('mark'", 1))
        .unwrap();
    fs::write(folder.path().join("logo.dxf"), SQUARE).unwrap();
    let correct = |part: &str, more: &[&str]| {
        let mut arguments = vec!["correct", part, "logo.dxf", "-o", "out.dxf", "--json"];
        arguments.extend(more);
        isomark(folder.path(), &arguments)
    };
    let converting = ["--set", "part.converter=freecad"];
    let out = folder.path().join("out.dxf");
    // Without the setting, FreeCAD is not started, and the remedy names the setting.
    let (code, words) = ended(correct("cap.step", &[]));
    assert_eq!(code, Some(1), "{words}");
    assert!(words.contains("step-face-unread") && words.contains("converter = "), "{words}");
    // Without FreeCAD.
    let mut without = correct("cap.step", &converting);
    without.env("PATH", "").env("ProgramFiles", "");
    let (code, words) = ended(without);
    assert_eq!(code, Some(1), "{words}");
    assert!(words.contains("step-face-unread") && words.contains("FreeCAD was not found"), "{words}");
    // Where the conversion loses what decides the place of the mark.
    let (code, words) = ended(correct("named.step", &converting));
    assert!(code == Some(1) && words.contains("'mark'"), "{words}");
    let (code, words) = ended(correct("cap.step", &[&converting[..], &["--part-unit", "cm"]].concat()));
    assert!(code == Some(1) && words.contains("part.unit"), "{words}");
    assert!(!out.exists());
    if freecad().is_none() {
        return;
    }
    let (code, words) = ended(correct("wrong.step", &converting));
    assert!(code == Some(1) && words.contains("is also rejected"), "{words}");
    let (code, words) = ended(correct("cap.step", &converting));
    assert!(code == Some(0) && words.contains("step-converted"), "{words}");
    assert!(out.exists());
    // In a station, where such a part is learned apart from the quick jobs.
    for name in ["hot", "import"] {
        fs::create_dir(folder.path().join(name)).unwrap();
    }
    let settings = "[station]\nname = \"caps\"\n[folders]\nhot = \"hot\"\nimport = \"import\"\n[field]\nwidth_mm = 100\n\
                    height_mm = 100\n[watch]\nsettle_ms = 60\nopen_ended_s = 0\n[part]\nconverter = \"freecad\"\n";
    fs::write(folder.path().join("station.toml"), settings).unwrap();
    fs::write(folder.path().join("hot/cap.step"), &cap).unwrap();
    fs::write(folder.path().join("hot/cap@logo.dxf"), SQUARE).unwrap();
    let (code, words) = ended(isomark(folder.path(), &["watch", "station.toml", "--once"]));
    assert_eq!(code, Some(0), "{words}");
    assert!(folder.path().join("import/cap@logo.dxf").exists(), "{words}");
}
