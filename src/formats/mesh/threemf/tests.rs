use std::io::Write;

use super::*;
use crate::formats::mesh::{self, Content, MeshOptions, PartReading};

fn read_part(bytes: &[u8]) -> Result<PartReading, MeshReadError> {
    mesh::read(bytes, MeshFormat::ThreeMf, &MeshOptions::default(), &BTreeMap::new())
}

fn arch(name: &str) -> Vec<u8> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/parts/arch").join(name);
    std::fs::read(&path).unwrap()
}

/// An archive with these entries, deflated or stored.
pub(crate) fn zip(entries: &[(&str, &[u8])], deflate: bool) -> Vec<u8> {
    let (mut archive, mut directory) = (Vec::new(), Vec::new());
    for (name, content) in entries {
        let mut crc = flate2::Crc::new();
        crc.update(content);
        let data = match deflate {
            false => content.to_vec(),
            true => {
                let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
                encoder.write_all(content).unwrap();
                encoder.finish().unwrap()
            }
        };
        let offset = archive.len() as u32;
        let mut common = vec![20, 0, 0, 0, if deflate { 8 } else { 0 }, 0, 0, 0, 0, 0];
        common.extend(crc.sum().to_le_bytes());
        common.extend((data.len() as u32).to_le_bytes());
        common.extend((content.len() as u32).to_le_bytes());
        common.extend((name.len() as u16).to_le_bytes());
        common.extend([0, 0]);
        archive.extend(b"PK\x03\x04");
        archive.extend(&common);
        archive.extend(name.bytes());
        archive.extend(data);
        directory.extend(b"PK\x01\x02\x14\0");
        directory.extend(&common);
        directory.extend([0; 10]);
        directory.extend(offset.to_le_bytes());
        directory.extend(name.bytes());
    }
    let start = archive.len() as u32;
    let count = (entries.len() as u16).to_le_bytes();
    archive.extend(&directory);
    archive.extend(b"PK\x05\x06\0\0\0\0");
    archive.extend(count.iter().chain(&count));
    archive.extend((directory.len() as u32).to_le_bytes());
    archive.extend(start.to_le_bytes());
    archive.extend([0, 0]);
    archive
}

const MESH: &str = "<mesh><vertices><vertex x='0' y='0' z='0'/><vertex x='30' y='0' z='0'/><vertex x='0' y='20' z='10'/>\
                    </vertices><triangles><triangle v1='0' v2='1' v3='2'/></triangles></mesh>";

fn model(attributes: &str, resources: &str, build: &str) -> String {
    format!(
        "<?xml version='1.0'?><model xmlns='http://schemas.microsoft.com/3dmanufacturing/core/2015/02' {attributes}>\
         <resources>{resources}</resources><build>{build}</build></model>"
    )
}

fn package(model: &str) -> Vec<u8> {
    zip(&[("3D/3dmodel.model", model.as_bytes())], true)
}

fn size(bytes: &[u8]) -> [f64; 3] {
    read_part(bytes).unwrap().facts.size
}

fn is_near(a: [f64; 3], b: [f64; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3)
}

#[test]
fn files_of_other_programs_have_their_size_and_places() {
    let width = 60.0 * std::f64::consts::FRAC_PI_3.sin();
    // Two arches; the second is turned by a quarter about z and moved by (100, 5, 2).
    let trimesh = read_part(&arch("trimesh.3mf")).unwrap();
    assert_eq!(trimesh.facts.triangles, 2 * 48 * 12 * 2);
    assert!(is_near(trimesh.facts.size, [width / 2.0 + 120.0, width, 17.0]), "{:?}", trimesh.facts.size);
    // In inches, with a mirrored component 4 inches away, and moved up by one inch.
    let lib3mf = read_part(&arch("lib3mf.3mf")).unwrap();
    assert!(is_near(lib3mf.facts.size, [101.6 + width, 40.0, 15.0]), "{:?}", lib3mf.facts.size);
    let mesh = lib3mf.shape.mesh().unwrap();
    assert!((mesh.bounds().0.z - (15.0 + 25.4)).abs() < 1e-3);
    let turned = mesh.triangles().iter().filter(|&&corners| {
        let [a, b, c] = mesh.corners(corners);
        (b - a).cross(&(c - a)).z <= 0.0
    });
    assert_eq!(turned.count(), 0, "mirrored triangles face the laser, too");
    assert_eq!(lib3mf.facts.bodies, ["arch", "arch"]);
    for part in [&trimesh, &lib3mf] {
        assert!(
            part.facts.notices.iter().all(|notice| notice.severity != crate::reason::Severity::Warning),
            "{part:?}"
        );
    }
}

#[test]
fn units_names_materials_and_supports_are_read() {
    for (unit, length) in
        [("micron", 0.03), ("millimeter", 30.0), ("centimeter", 300.0), ("inch", 762.0), ("foot", 9144.0)]
    {
        let text = model(
            &format!("unit='{unit}'"),
            &format!("<object id='1'>{MESH}</object>"),
            "<item objectid='1'/>",
        );
        assert!((size(&package(&text))[0] / length - 1.0).abs() < 1e-12, "{unit}");
    }
    let text = model(
        "",
        &format!(
            "<basematerials id='9'><base name='steel'/><base name='mark'/></basematerials>\
             <object id='1' name='can &amp; lid' pid='9' pindex='0'>{}</object>\
             <object id='2' type='support'>{MESH}</object>",
            MESH.replace("v3='2'/>", "v3='2'/><triangle v1='0' v2='2' v3='1' pid='9' p1='1'/>")
        ),
        "<item objectid='1'/><item objectid='2'/>",
    );
    let text = text.replace("<resources>", "<metadata name='Application'>a test</metadata><resources>");
    let part = read_part(&package(&text)).unwrap();
    assert_eq!(
        (&part.facts.bodies[..], part.facts.producer.as_deref()),
        (&["can & lid".to_owned()][..], Some("a test"))
    );
    assert_eq!(
        (part.facts.materials, part.facts.skipped),
        (vec!["steel".into(), "mark".into()], vec!["1 x support".to_owned()])
    );
    assert_eq!(part.mark_faces.len(), 1);
}

#[test]
fn items_that_are_not_printed_are_left_out_with_a_notice() {
    let read =
        |items: &str| read_part(&package(&model("", &format!("<object id='1'>{MESH}</object>"), items)));
    let far = "transform='1 0 0 0 1 0 0 0 1 500 0 0'";
    let shown = read("<item objectid='1' printable='1'/>").unwrap();
    let part = read(&format!("<item objectid='1'/><item objectid='1' printable='0' {far}/>")).unwrap();
    assert_eq!((part.facts.size, part.facts.triangles), (shown.facts.size, shown.facts.triangles));
    assert!(part.facts.notices.iter().any(|notice| notice.code == "part-hidden"));
    assert!(shown.facts.notices.iter().all(|notice| notice.code != "part-hidden"));
    let none = read("<item objectid='1' printable='0'/>");
    let cause = EmptyCause::OnlyOthers(vec!["1 x hidden object".into()]);
    assert_eq!(none, Err(MeshReadError::NoTriangles { cause }));
}

#[test]
fn components_in_other_models_of_the_package_are_read() {
    let root = model(
        "xmlns:p='http://schemas.microsoft.com/3dmanufacturing/production/2015/06' requiredextensions='p'",
        "<object id='5'><components><component p:path='/3D/Objects/a.model' objectid='1' transform='0 1 0 -1 0 0 0 0 1 7 0 0'/>\
         </components></object>",
        "<item objectid='5'/>",
    );
    let other = model("", &format!("<object id='1'>{MESH}</object>"), "<item objectid='99'/>");
    let relations = "<Relationships xmlns='r'><Relationship Target='/3D/root.model' Id='r' \
                     Type='http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel'/></Relationships>";
    for deflate in [true, false] {
        let entries = [("_rels/.rels", relations), ("3D/root.model", &root), ("3D/Objects/a.model", &other)];
        let bytes = zip(&entries.map(|(name, text)| (name, text.as_bytes())), deflate);
        assert_eq!(size(&bytes), [20.0, 30.0, 10.0]);
    }
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let refused = |text: &str| read_part(&package(text)).unwrap_err().to_string();
    let object = format!("<object id='1'>{MESH}</object>");
    let item = "<item objectid='1'/>";
    for (text, words) in [
        (model("", &object, "<item objectid='2'/>"), "object 2 does not exist"),
        (model("unit='parsec'", &object, item), "the unit \"parsec\" is unknown"),
        (
            model("", "<object id='1'><components><component objectid='1'/></components></object>", item),
            "contains itself",
        ),
        (model("", &object.replace("x='30'", "x='30mm'"), item), "x=\"30mm\" is not a number"),
        (model("", &object.replace("x='30'", "x='inf'"), item), "invalid coordinates"),
        (model("", &object.replace("x='30' ", ""), item), "a vertex has no x"),
        (model("", &object.replace("v3='2'", "v3='3'"), item), "vertex 3"),
        (model("", &object, "<item objectid='1' transform='1 0 0'/>"), "not twelve numbers"),
        (model("", "<object id='1'/>", item), "no triangle"),
        (model("requiredextensions='b' xmlns:b='urn:bool'", &object, item), "urn:bool"),
        (format!("<!DOCTYPE m [<!ENTITY a 'aaaa'>]>{}", model("", &object, item)), "document type"),
        (model("", &object, item).replace("</mesh>", "</mosh>"), "3d/3dmodel.model"),
    ] {
        assert!(refused(&text).contains(words), "{words}: {}", refused(&text));
    }
    let reason = read_part(&package(&model("", &object.replace("x='30' ", ""), item))).unwrap_err().reason();
    assert!(reason.code == "mesh-package-invalid" && reason.place.byte.is_some(), "{reason:?}");
    // Entities that are not predefined are not expanded.
    assert!(refused(&model("", "<object id='1' name='&bomb;'/>", item)).contains("bomb"));
    assert!(
        read_part(&zip(&[("3D/other.txt", b"x")], true)).unwrap_err().to_string().contains("ZIP archive")
    );
}

#[test]
fn bombs_of_text_and_of_components_end_early() {
    // 64 MB of blanks compress to 64 kB.
    let mut text = model("", "", "");
    text.push_str(&" ".repeat(64 << 20));
    let bytes = package(&text);
    assert!(bytes.len() < 1 << 20);
    let refused = read_part(&bytes).unwrap_err().to_string();
    assert!(refused.contains("longer than 16 MB") || refused.contains("100 times"), "{refused}");
    // Ten components in each of twelve levels are 10^12 objects.
    let mut objects = format!("<object id='1'>{MESH}</object>");
    for level in 2..14 {
        let component = format!("<component objectid='{}'/>", level - 1);
        objects +=
            &format!("<object id='{level}'><components>{}</components></object>", component.repeat(10));
    }
    let many = read_part(&package(&model("", &objects, "<item objectid='13'/>"))).unwrap_err();
    assert!(matches!(many, MeshReadError::TooLarge { .. }), "{many}");
}

#[test]
fn incomplete_and_damaged_packages_are_refused_without_a_panic() {
    let object = format!("<object id='1'>{MESH}</object>");
    let bytes = package(&model("", &object, "<item objectid='1'/>"));
    assert!(mesh::is_whole(&bytes, MeshFormat::ThreeMf).is_ok());
    for length in 0..bytes.len() {
        let cut = mesh::is_whole(&bytes[..length], MeshFormat::ThreeMf).unwrap_err();
        assert!(cut.is_cut_short() || length < 4, "{length}: {cut}");
        assert!(read_part(&bytes[..length]).is_err());
    }
    for at in 0..bytes.len() {
        for flip in [0x01, 0x80, 0xff] {
            let mut damaged = bytes.clone();
            damaged[at] ^= flip;
            let _ = read_part(&damaged);
            let _ = mesh::is_whole(&damaged, MeshFormat::ThreeMf);
        }
    }
    let stored = zip(&[("3D/3dmodel.model", model("", &object, "<item objectid='1'/>").as_bytes())], false);
    let at = stored.windows(6).position(|six| six == b"x='30'").unwrap();
    let mut changed = stored.clone();
    changed[at + 3] = b'4';
    let refused = read_part(&changed).unwrap_err().to_string();
    assert!(refused.contains("checksum"), "{refused}");
}

#[test]
fn files_of_other_formats_are_called_by_their_names() {
    let object = format!("<object id='1'>{MESH}</object>");
    let threemf = package(&model("", &object, "<item objectid='1'/>"));
    let other = zip(&[("notes.txt", b"x")], false);
    let mut binary_stl = vec![0; 84 + 50];
    binary_stl[..9].copy_from_slice(b"PK\x03\x04 free");
    binary_stl[80] = 1;
    let mut named_stl = binary_stl.clone();
    named_stl[..9].copy_from_slice(b"a program");
    for (bytes, found) in [
        (&threemf[..], Content::ThreeMf),
        (&other, Content::Zip),
        (b"\x1f\x8b\x08\0\0\0\0\0\0\x03abc", Content::Gzip),
        (b"ISO-10303-21;\nHEADER;\n", Content::Step),
        (b"%PDF-1.7\n", Content::Pdf),
        (b"<!DOCTYPE html>\n<html>", Content::Html),
        (b"<?xml version='1.0'?>\n<svg xmlns='http://www.w3.org/2000/svg'/>", Content::Svg),
        (b"  0\nSECTION\n  2\nHEADER\n", Content::Dxf),
        (b"ply\nformat ascii 1.0\n", Content::Ply),
        (b"solid can\n  facet normal 0 0 1\n    outer loop\n", Content::Stl),
        (&named_stl, Content::Stl),
        (b"# a program\n\nmtllib can.mtl\no Can\nv 0.5 -1 2e1\nv 1 0 0\n", Content::Obj),
        (b"<?xml version=\"1.0\"?>\n<amf unit=\"millimeter\">\n", Content::Amf),
    ] {
        for format in [
            MeshFormat::Stl,
            MeshFormat::Obj,
            MeshFormat::Ply,
            MeshFormat::Glb,
            MeshFormat::Xyz,
            MeshFormat::ThreeMf,
        ] {
            let own = matches!(
                (format, found),
                (MeshFormat::Ply, Content::Ply)
                    | (MeshFormat::ThreeMf, Content::ThreeMf)
                    | (MeshFormat::Stl, Content::Stl)
                    | (MeshFormat::Obj, Content::Obj)
            );
            if own {
                continue;
            }
            let refused = mesh::read(bytes, format, &MeshOptions::default(), &BTreeMap::new());
            assert_eq!(refused, Err(MeshReadError::OtherFormat { format, found }), "{format}");
            let whole = mesh::is_whole(bytes, format);
            assert!(
                !whole.is_err_and(|error| error.is_cut_short()),
                "{format} waits for the rest of {found}"
            );
        }
    }
    let reason = MeshReadError::OtherFormat { format: MeshFormat::Stl, found: Content::ThreeMf }.reason();
    assert!(reason.what.contains("it is a 3MF file") && reason.remedy.contains(".3mf"), "{reason:?}");
    assert!(mesh::is_whole(&binary_stl, MeshFormat::Stl).is_ok());
}
