use super::*;
use crate::reason::Severity;

/// A part with corners at 0 and `size`, in the file's numbers.
fn corners(size: [f64; 3]) -> Corners {
    Corners { min: Vector3::zeros(), size: Vector3::from(size), dust: [0; 3] }
}

fn clues(format: MeshFormat, producer: &str) -> Clues {
    Clues::new(format, (!producer.is_empty()).then(|| producer.to_string()))
}

/// Unit, axis, and the severity of both notices.
fn decided(clues: &Clues, corners: &Corners) -> (LengthUnit, UpAxis, [Severity; 2]) {
    let verdict = clues.judge(corners, &MeshOptions::default());
    assert!(!verdict.unit.why.is_empty() && !verdict.up.why.is_empty());
    let severity = |code: &str| verdict.notices.iter().find(|notice| notice.code == code).unwrap().severity;
    (verdict.unit.value, verdict.up.value, [severity("unit-assumed"), severity("axis-assumed")])
}

use LengthUnit::{Metre, Millimetre};
use MeshFormat::{Glb, Obj};
use Severity::{Note, Warning};
use UpAxis::{Y, Z};

#[test]
fn the_standard_applies_unless_the_size_contradicts_it() {
    let program = clues(Glb, "some program");
    assert_eq!(decided(&program, &corners([0.066, 0.115, 0.066])), (Metre, Y, [Note, Note]));
    assert_eq!(decided(&program, &corners([66.0, 115.0, 66.0])), (Millimetre, Y, [Warning, Warning]));
    let blender = clues(Glb, "Khronos glTF Blender I/O v4.2.83");
    assert_eq!(decided(&blender, &corners([66.0, 115.0, 66.0])), (Millimetre, Y, [Warning, Note]));
}

#[test]
fn blender_files_of_an_imported_z_up_obj_are_set_upright() {
    let mut blender = clues(Glb, "Khronos glTF Blender I/O v5.2.41");
    blender.root_turn = RootTurn::UpToFront;
    assert_eq!(decided(&blender, &corners([66.0, 66.0, 115.0])), (Millimetre, Z, [Warning, Warning]));
    // In metres the designer may have made the rotation.
    assert_eq!(decided(&blender, &corners([0.066, 0.066, 0.115])), (Metre, Y, [Note, Note]));
}

#[test]
fn signed_zeros_in_normals_show_the_axis_of_open_cascade_files() {
    let mut cascade = clues(Glb, "Open CASCADE Technology 8.0 [dev.opencascade.org]");
    let can = corners([0.066, 0.066, 0.115]);
    assert_eq!(decided(&cascade, &can), (Metre, Y, [Note, Warning]));
    cascade.zeros.count([0.0, -1.0, 0.0]);
    assert_eq!(decided(&cascade, &can), (Metre, Y, [Note, Note]));
    cascade.zeros.count([-0.0, -0.0, -1.0]);
    assert_eq!(decided(&cascade, &can), (Metre, Z, [Note, Warning]));
    cascade.root_turn = RootTurn::FrontToUp;
    assert_eq!(decided(&cascade, &can), (Metre, Y, [Note, Note]));
}

#[test]
fn unit_and_axis_of_obj_files_depend_on_their_producer() {
    let can = corners([66.0, 66.0, 115.0]);
    assert_eq!(decided(&clues(Obj, "Created by FreeCAD <http>"), &can), (Millimetre, Z, [Note, Note]));
    assert_eq!(decided(&clues(Obj, ""), &can), (Millimetre, Z, [Warning, Warning]));
    let in_metres = corners([0.066, 0.066, 0.115]);
    assert_eq!(decided(&clues(Obj, "Blender 4.2"), &in_metres), (Metre, Y, [Note, Note]));
    assert_eq!(decided(&clues(Obj, ""), &in_metres), (Metre, Z, [Warning, Warning]));
}

#[test]
fn rounding_or_the_base_plane_shows_the_axis_of_blender_obj_files_in_mm() {
    let blender = clues(Obj, "Blender 5.2.3 LTS");
    let standing = |min: [f64; 3], dust| {
        let size = Vector3::new(66.0, 66.0, 115.0);
        decided(&blender, &Corners { min: Vector3::from(min), size, dust }).1
    };
    assert_eq!(standing([-33.0, -33.0, 0.1], [0; 3]), Z);
    assert_eq!(standing([-33.0, 0.1, -33.0], [0; 3]), Y);
    assert_eq!(standing([-33.0, -33.0, -50.0], [0; 3]), Y);
    assert_eq!(standing([-33.0, -33.0, -50.0], [0, 4, 2]), Z);
    assert_eq!(standing([-33.0, -33.0, -50.0], [1, 4, 2]), Y);
}

#[test]
fn settings_override_without_a_notice() {
    let options = MeshOptions { unit: Some(LengthUnit::Centimetre), up: Some(Z), ..MeshOptions::default() };
    let verdict = clues(Glb, "").judge(&corners([6.6, 6.6, 11.5]), &options);
    assert_eq!((verdict.unit.value, verdict.up.value), (LengthUnit::Centimetre, Z));
    assert_eq!(verdict.unit.why, "the settings say so");
    assert!(verdict.notices.is_empty(), "{:?}", verdict.notices);
}

#[test]
fn implausible_sizes_are_reported_with_their_number() {
    for (size, number) in [(0.0005, "0.500 mm"), (3.0, "3000.000 mm")] {
        let verdict = clues(Glb, "").judge(&corners([size, 0.0, 0.0]), &MeshOptions::default());
        let notice = verdict.notices.iter().find(|notice| notice.code == "size-implausible").unwrap();
        assert!(notice.message.contains(number), "{}", notice.message);
        assert_eq!(notice.severity, Warning);
    }
}
