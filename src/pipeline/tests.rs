use super::learning::identified;
use super::*;
use crate::cache::CurrentPart;
use crate::formats::mesh::{LengthUnit, PartFile, UpAxis};
use crate::geometry::primitive::Primitive;

/// Two plates of 100 x 100 mm, the second one bent.
const PLATES: [&str; 2] = [
    "v -50 -50 5\nv 50 -50 5\nv 50 50 5\nv -50 50 5\nf 1 2 3 4\n",
    "v -50 -50 0\nv 0 -50 5\nv 50 -50 0\nv -50 50 0\nv 0 50 5\nv 50 50 0\nf 1 2 5 4\nf 2 3 6 5\n",
];

fn settings() -> PartSettings {
    PartSettings { unit: Some(LengthUnit::Millimetre), up: Some(UpAxis::Z), ..PartSettings::default() }
}

#[test]
fn a_part_is_plain_data_that_threads_can_share() {
    fn is_plain<Data: Send + Sync + Clone + 'static>() {}
    is_plain::<PartFile>();
}

/// A change here makes every delivered drawing for such parts outdated.
#[test]
fn the_hash_of_a_part_is_that_of_its_files() {
    let hash = |siblings: &[(&str, &str)]| {
        let siblings = siblings.iter().map(|(name, content)| (name.to_string(), content.as_bytes().to_vec()));
        let part = PartFile { siblings: siblings.collect(), ..PartFile::alone("can.gltf", *b"{}") };
        identified(&part).0.blake3
    };
    let of = |bytes: &[u8]| blake3::hash(bytes).to_hex().to_string();
    assert_eq!(hash(&[]), of(b"{}"));
    assert_eq!(hash(&[("a.bin", "xyz")]), of(b"{}xyz"));
    assert_ne!(hash(&[("a.bin", "xyZ")]), hash(&[("a.bin", "xyz")]));
    // The files are hashed in the order in which the part names them.
    let text = r#"{"asset": {"version": "2.0"}, "buffers": [
        {"uri": "part10.bin", "byteLength": 1}, {"uri": "part2.bin", "byteLength": 2}]}"#;
    let named = [("part2.bin", "yz"), ("part10.bin", "x")];
    let siblings = named.map(|(name, content)| (name.to_owned(), content.as_bytes().to_vec())).into();
    let part = PartFile { siblings, ..PartFile::alone("can.gltf", text) };
    assert_eq!(identified(&part).0.blake3, of(format!("{text}xyz").as_bytes()));
}

#[test]
fn sizes_in_the_settings_do_not_change_the_current_part() {
    let folder = tempfile::tempdir().unwrap();
    let (pipeline, sku) = (Pipeline::new(Some(Cache::new(folder.path()))), "plate".parse().unwrap());
    let [flat, _] = PLATES.map(|text| PartFile::alone("plate.obj", text));
    let learned = pipeline.learn(&sku, &flat, &settings()).unwrap();
    let cylinder = PartSettings {
        primitive: Some(Primitive::new(73.0, 73.0, 180.0, nalgebra::Vector3::y()).unwrap()),
        ..settings()
    };
    for _ in 0..2 {
        let made = pipeline.recall(&sku, &cylinder, &mut Vec::new()).unwrap().unwrap();
        assert_ne!(made.key, learned.key);
    }
    let again = pipeline.recall(&sku, &settings(), &mut Vec::new()).unwrap().unwrap();
    assert_eq!((again.key, again.kept.origin), (learned.key, learned.kept.origin));
    assert!(pipeline.restore(&sku, &flat, &settings()).is_ok());
}

#[test]
fn a_part_is_restored_unless_another_one_was_learned_since() {
    let folder = tempfile::tempdir().unwrap();
    let (pipeline, sku) = (Pipeline::new(Some(Cache::new(folder.path()))), "plate".parse().unwrap());
    let [flat, bent] = PLATES.map(|text| PartFile::alone("plate.obj", text));
    // In a new cache the SKU is unknown.
    let first = pipeline.restore(&sku, &flat, &settings()).unwrap();
    assert!(!first.from_cache && pipeline.restore(&sku, &flat, &settings()).unwrap().from_cache);
    let second = pipeline.learn(&sku, &bent, &settings()).unwrap();
    assert_ne!(first.key, second.key);
    let Err(PipelineError::Rejected(reason)) = pipeline.restore(&sku, &flat, &settings()) else {
        panic!("the older part is accepted")
    };
    assert_eq!(reason.code, "newer-elsewhere");
    assert_eq!(
        pipeline.current_part(&sku, &settings()).unwrap(),
        Some(CurrentPart::new(identified(&bent).0, false))
    );
    assert!(pipeline.learn(&sku, &flat, &settings()).unwrap().from_cache);
}
