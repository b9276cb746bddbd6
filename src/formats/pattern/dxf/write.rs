//! The writer: polylines with straight segments in mm, and only the structure that readers need.
//!
//! R2000 files contain the tables, blocks and objects that strict readers require, R12 files need few of them. Lines
//! end with CR LF, as AutoCAD writes them; the same drawing always gives the same bytes.

use std::collections::BTreeSet;
use std::fmt::{Display, Write};

use crate::geometry::marking::{MarkingDrawing, MarkingPath, MarkingShape};
use crate::geometry::pattern::{Color, Layer};
use crate::geometry::space::{Extents, FieldPoint};
use crate::reason::Notice;

/// The version of DXF to write.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum DxfProfile {
    /// AC1015: LWPOLYLINE, units in the header, true colours, layer names in any alphabet.
    #[default]
    R2000,
    /// AC1009: POLYLINE with VERTEX; without a unit and true colours, with short ASCII layer names.
    R12,
    /// AC1009 with a LINE for every piece, for importers that read nothing else. Contours are split into their sides.
    R12Lines,
}

impl DxfProfile {
    fn is_r12(self) -> bool {
        self != Self::R2000
    }
}

/// The drawing as a DXF file in millimetres.
///
/// Coordinates have at most six decimals. A path with a single point becomes a POINT; a path without points is skipped.
pub fn write(drawing: &MarkingDrawing, profile: DxfProfile) -> Vec<u8> {
    let mut file = Groups::new(FIRST_FREE_HANDLE, profile);
    for comment in &drawing.comments {
        comment_lines(comment).iter().for_each(|line| file.put(999, line));
    }
    let names = layer_names(&drawing.layers, profile);
    let mut entities = Groups::new(FIRST_FREE_HANDLE, profile);
    for path in &drawing.paths {
        entity(&mut entities, path, names.get(path.layer).map_or("0", String::as_str));
    }
    file.next_handle = entities.next_handle;

    header(&mut file, &drawing.extents(), drawing.layers.len());
    file.section("TABLES", |file| tables(file, &drawing.layers, &names));
    file.section("BLOCKS", blocks);
    file.section("ENTITIES", |file| file.text.push_str(&entities.text));
    if profile == DxfProfile::R2000 {
        file.section("OBJECTS", objects);
    }
    file.put(0, "EOF");
    file.text.into_bytes()
}

/// Warnings about data that the profile cannot represent: layer names that must change, and true colours that become
/// the nearest colours of the table.
#[must_use]
pub fn losses(drawing: &MarkingDrawing, profile: DxfProfile) -> Vec<Notice> {
    let mut losses = Vec::new();
    let names = plain_layer_names(&drawing.layers, profile);
    let renamed: Vec<String> = drawing
        .layers
        .iter()
        .zip(names)
        .filter(|(layer, name)| layer.name != *name)
        .map(|(layer, name)| format!("{} is {name}", layer.name))
        .collect();
    if !renamed.is_empty() {
        let message = format!(
            "the DXF file cannot contain some layer names, so these layers are renamed: {}",
            renamed.join(", ")
        );
        losses.push(Notice::warning("layers-renamed", message));
    }
    let colors = drawing.layers.iter().map(|layer| layer.color);
    let colors = colors.chain(drawing.paths.iter().map(|path| path.color));
    let replaced = colors.filter(|color| profile.is_r12() && matches!(color, Color::Rgb { .. })).count();
    if replaced > 0 {
        let message = format!(
            "R12 has no true colours: layers and paths use the nearest colours of its table (replaced colours: \
             {replaced})"
        );
        losses.push(Notice::warning("colours-replaced", message));
    }
    losses
}

// Handles of the fixed parts of an R2000 file; those of layers and entities start at `FIRST_FREE_HANDLE`.
const BLOCK_RECORD_TABLE: u64 = 0x1;
const LAYER_TABLE: u64 = 0x2;
const STYLE_TABLE: u64 = 0x3;
const LINE_TYPE_TABLE: u64 = 0x5;
const VIEW_TABLE: u64 = 0x6;
const UCS_TABLE: u64 = 0x7;
const VIEWPORT_TABLE: u64 = 0x8;
const APPLICATION_TABLE: u64 = 0x9;
const DIMENSION_STYLE_TABLE: u64 = 0xA;
const ROOT_DICTIONARY: u64 = 0xC;
const GROUP_DICTIONARY: u64 = 0xD;
const LAYOUT_DICTIONARY: u64 = 0xE;
const STANDARD_STYLE: u64 = 0x11;
pub(super) const MODEL_SPACE: u64 = 0x20;
const PAPER_SPACE: u64 = 0x21;
const MODEL_LAYOUT: u64 = 0x22;
const PAPER_LAYOUT: u64 = 0x23;
pub(super) const FIRST_FREE_HANDLE: u64 = 0x100;

/// Group codes and values, one per line.
pub(super) struct Groups {
    pub(super) text: String,
    pub(super) next_handle: u64,
    profile: DxfProfile,
}

impl Groups {
    pub(super) fn new(next_handle: u64, profile: DxfProfile) -> Self {
        Self { text: String::new(), next_handle, profile }
    }

    pub(super) fn put(&mut self, code: u16, value: impl Display) {
        // Writing into a String cannot fail.
        let _ = write!(self.text, "{code:>3}\r\n{value}\r\n");
    }

    pub(super) fn put_all(&mut self, groups: &[(u16, &str)]) {
        groups.iter().for_each(|(code, value)| self.put(*code, value));
    }

    fn put_point(&mut self, code: u16, point: FieldPoint) {
        for (code, value) in [(code, point.x), (code + 10, point.y)] {
            // Writing into a String cannot fail.
            let _ = write!(self.text, "{code:>3}\r\n");
            push_number(&mut self.text, value);
            self.text.push_str("\r\n");
        }
    }

    fn put_handle(&mut self, code: u16, handle: u64) {
        if self.profile == DxfProfile::R2000 {
            self.put(code, format_args!("{handle:X}"));
        }
    }

    /// A new handle with the handle of its owner.
    pub(super) fn put_new_handle(&mut self, owner: u64) {
        self.put_handle(5, self.next_handle);
        self.put_handle(330, owner);
        self.next_handle += 1;
    }

    pub(super) fn put_class(&mut self, class: &str) {
        if self.profile == DxfProfile::R2000 {
            self.put(100, class);
        }
    }

    pub(super) fn section(&mut self, name: &str, content: impl FnOnce(&mut Self)) {
        self.put_all(&[(0, "SECTION"), (2, name)]);
        content(self);
        self.put(0, "ENDSEC");
    }

    fn table(&mut self, name: &str, handle: u64, entries: usize, content: impl FnOnce(&mut Self)) {
        self.put_all(&[(0, "TABLE"), (2, name)]);
        self.put_handle(5, handle);
        self.put_handle(330, 0);
        self.put_class("AcDbSymbolTable");
        self.put(70, entries);
        if name == "DIMSTYLE" {
            self.put_class("AcDbDimStyleTable");
        }
        content(self);
        self.put(0, "ENDTAB");
    }

    fn table_entry(&mut self, kind: &str, class: &str, table: u64, name: &str) {
        self.put(0, kind);
        self.put_new_handle(table);
        self.put_class("AcDbSymbolTableRecord");
        self.put_class(class);
        self.put(2, name);
        self.put(70, 0);
    }
}

pub(super) fn header(file: &mut Groups, extents: &Extents, layers: usize) {
    let (min, max) = if extents.is_empty() { Default::default() } else { (extents.min, extents.max) };
    file.section("HEADER", |file| {
        file.put_all(&[(9, "$ACADVER"), (1, if file.profile.is_r12() { "AC1009" } else { "AC1015" })]);
        if file.profile == DxfProfile::R2000 {
            file.put_all(&[(9, "$DWGCODEPAGE"), (3, "ANSI_1252")]);
        }
        for (name, corner) in [("$EXTMIN", min), ("$EXTMAX", max)] {
            file.put(9, name);
            file.put_point(10, corner.into());
            file.put(30, "0.0");
        }
        if file.profile == DxfProfile::R2000 {
            file.put_all(&[(9, "$INSUNITS"), (70, "4"), (9, "$MEASUREMENT"), (70, "1"), (9, "$HANDSEED")]);
            // Layers and table entries get their handles later; 0x100 are more than enough.
            file.put(5, format_args!("{:X}", file.next_handle + layers as u64 + 0x100));
        }
    });
}

pub(super) fn tables(file: &mut Groups, layers: &[Layer], names: &[String]) {
    let r2000 = file.profile == DxfProfile::R2000;
    if r2000 {
        file.table("VPORT", VIEWPORT_TABLE, 0, |_| {});
    }
    file.table("LTYPE", LINE_TYPE_TABLE, if r2000 { 3 } else { 1 }, |file| {
        let names: &[&str] = if r2000 { &["ByBlock", "ByLayer", "Continuous"] } else { &["CONTINUOUS"] };
        for name in names {
            file.table_entry("LTYPE", "AcDbLinetypeTableRecord", LINE_TYPE_TABLE, name);
            file.put_all(&[(3, ""), (72, "65"), (73, "0"), (40, "0.0")]);
        }
    });
    let has_zero = names.iter().any(|name| name == "0");
    file.table("LAYER", LAYER_TABLE, names.len() + usize::from(!has_zero), |file| {
        if !has_zero {
            layer_entry(file, "0", Color::Aci(7));
        }
        for (layer, name) in layers.iter().zip(names) {
            layer_entry(file, name, layer.color);
        }
    });
    file.table("STYLE", STYLE_TABLE, 1, |file| {
        file.put(0, "STYLE");
        file.put_handle(5, STANDARD_STYLE);
        file.put_handle(330, STYLE_TABLE);
        file.put_class("AcDbSymbolTableRecord");
        file.put_class("AcDbTextStyleTableRecord");
        file.put_all(&[(2, "Standard"), (70, "0"), (40, "0.0"), (41, "1.0"), (50, "0.0"), (71, "0")]);
        file.put_all(&[(42, "2.5"), (3, "txt"), (4, "")]);
    });
    if !r2000 {
        return;
    }
    file.table("VIEW", VIEW_TABLE, 0, |_| {});
    file.table("UCS", UCS_TABLE, 0, |_| {});
    file.table("APPID", APPLICATION_TABLE, 1, |file| {
        file.table_entry("APPID", "AcDbRegAppTableRecord", APPLICATION_TABLE, "ACAD");
    });
    file.table("DIMSTYLE", DIMENSION_STYLE_TABLE, 1, |file| {
        file.put(0, "DIMSTYLE");
        file.put_handle(105, file.next_handle);
        file.next_handle += 1;
        file.put_handle(330, DIMENSION_STYLE_TABLE);
        file.put_class("AcDbSymbolTableRecord");
        file.put_class("AcDbDimStyleTableRecord");
        file.put_all(&[(2, "Standard"), (70, "0")]);
        file.put_handle(340, STANDARD_STYLE);
    });
    file.table("BLOCK_RECORD", BLOCK_RECORD_TABLE, 2, |file| {
        for (name, handle, layout) in
            [("*Model_Space", MODEL_SPACE, MODEL_LAYOUT), ("*Paper_Space", PAPER_SPACE, PAPER_LAYOUT)]
        {
            file.put(0, "BLOCK_RECORD");
            file.put_handle(5, handle);
            file.put_handle(330, BLOCK_RECORD_TABLE);
            file.put_class("AcDbSymbolTableRecord");
            file.put_class("AcDbBlockTableRecord");
            file.put(2, name);
            file.put_handle(340, layout);
        }
    });
}

fn layer_entry(file: &mut Groups, name: &str, layer_color: Color) {
    file.table_entry("LAYER", "AcDbLayerTableRecord", LAYER_TABLE, name);
    if layer_color == Color::ByLayer {
        color(file, Color::Aci(7));
    } else {
        color(file, layer_color);
    }
    file.put(6, if file.profile.is_r12() { "CONTINUOUS" } else { "Continuous" });
}

pub(super) fn color(file: &mut Groups, color: Color) {
    let (aci, rgb) = match color {
        Color::ByLayer => return,
        Color::Aci(aci) => (aci, None),
        Color::Rgb { aci, rgb } => (aci, Some(rgb)),
    };
    // 0 would mean BYBLOCK, but there are no blocks.
    file.put(62, if aci == 0 { 7 } else { aci });
    if let (Some([red, green, blue]), DxfProfile::R2000) = (rgb, file.profile) {
        file.put(420, u32::from_be_bytes([0, red, green, blue]));
    }
}

pub(super) fn blocks(file: &mut Groups) {
    if file.profile.is_r12() {
        return;
    }
    for (name, record) in [("*Model_Space", MODEL_SPACE), ("*Paper_Space", PAPER_SPACE)] {
        file.put(0, "BLOCK");
        file.put_new_handle(record);
        file.put_class("AcDbEntity");
        file.put(8, "0");
        file.put_class("AcDbBlockBegin");
        file.put_all(&[(2, name), (70, "0"), (10, "0.0"), (20, "0.0"), (30, "0.0"), (3, name), (1, "")]);
        file.put(0, "ENDBLK");
        file.put_new_handle(record);
        file.put_class("AcDbEntity");
        file.put(8, "0");
        file.put_class("AcDbBlockEnd");
    }
}

/// Writes one entity for the path, or with [`DxfProfile::R12Lines`] one for each of its pieces.
fn entity(file: &mut Groups, path: &MarkingPath, layer: &str) {
    let points = path.shape.points();
    let closed = matches!(path.shape, MarkingShape::Closed(_));
    let begin = |file: &mut Groups, kind: &str, class: &str| {
        file.put(0, kind);
        file.put_new_handle(MODEL_SPACE);
        file.put_class("AcDbEntity");
        file.put(8, layer);
        color(file, path.color);
        file.put_class(class);
    };
    match (points, file.profile) {
        ([], _) => {}
        ([point], _) => {
            begin(file, "POINT", "AcDbPoint");
            file.put_point(10, *point);
            file.put(30, "0.0");
        }
        (points, DxfProfile::R2000) => {
            begin(file, "LWPOLYLINE", "AcDbPolyline");
            file.put(90, points.len());
            file.put(70, u8::from(closed));
            points.iter().for_each(|point| file.put_point(10, *point));
        }
        (points, DxfProfile::R12) => {
            begin(file, "POLYLINE", "");
            file.put_all(&[(66, "1"), (70, if closed { "1" } else { "0" })]);
            file.put_all(&[(10, "0.0"), (20, "0.0"), (30, "0.0")]);
            for point in points {
                file.put_all(&[(0, "VERTEX"), (8, layer)]);
                file.put_point(10, *point);
                file.put(30, "0.0");
            }
            // Without a layer: FreeCAD reads line by line here and would read layer 0 as the next entity's group code.
            file.put(0, "SEQEND");
        }
        (points, DxfProfile::R12Lines) => {
            let back = points.first().filter(|_| closed);
            for (from, to) in points.iter().zip(points.iter().skip(1).chain(back)) {
                begin(file, "LINE", "");
                for (code, point) in [(10, from), (11, to)] {
                    file.put_point(code, *point);
                    file.put(code + 20, "0.0");
                }
            }
        }
    }
}

pub(super) fn objects(file: &mut Groups) {
    let dictionary = |file: &mut Groups, handle: u64, owner: u64, entries: &[(&str, u64)]| {
        file.put(0, "DICTIONARY");
        file.put_handle(5, handle);
        file.put_handle(330, owner);
        file.put_class("AcDbDictionary");
        file.put(281, 1);
        for (name, handle) in entries {
            file.put(3, name);
            file.put_handle(350, *handle);
        }
    };
    let root = [("ACAD_GROUP", GROUP_DICTIONARY), ("ACAD_LAYOUT", LAYOUT_DICTIONARY)];
    dictionary(file, ROOT_DICTIONARY, 0, &root);
    dictionary(file, GROUP_DICTIONARY, ROOT_DICTIONARY, &[]);
    let layouts = [("Layout1", PAPER_LAYOUT), ("Model", MODEL_LAYOUT)];
    dictionary(file, LAYOUT_DICTIONARY, ROOT_DICTIONARY, &layouts);
    for (name, handle, record, tab) in
        [("Model", MODEL_LAYOUT, MODEL_SPACE, 0), ("Layout1", PAPER_LAYOUT, PAPER_SPACE, 1)]
    {
        file.put(0, "LAYOUT");
        file.put_handle(5, handle);
        file.put_handle(330, LAYOUT_DICTIONARY);
        file.put_class("AcDbPlotSettings");
        file.put_all(&[(1, ""), (2, "none_device"), (4, ""), (6, "")]);
        // 1024: the tab is the model.
        file.put(70, if tab == 0 { 1024 } else { 0 });
        file.put_class("AcDbLayout");
        file.put(1, name);
        file.put(70, 1);
        file.put(71, tab);
        file.put_handle(330, record);
    }
}

/// Adds a number with at most six decimals and at least one, without trailing zeros and never `-0.0`.
fn push_number(text: &mut String, value: f64) {
    let start = text.len();
    // Writing into a String cannot fail.
    let _ = write!(text, "{value:.6}");
    text.truncate(start + text[start..].trim_end_matches('0').len());
    if text.ends_with('.') {
        text.push('0');
    }
    if &text[start..] == "-0.0" {
        text.remove(start);
    }
}

/// A number as [`Groups::put_point`] writes it.
pub(super) fn number(value: f64) -> String {
    let mut text = String::new();
    push_number(&mut text, value);
    text
}

/// Text in ASCII, with other letters as `\U+XXXX`; `_` replaces control characters and letters that need more than four
/// digits.
fn escaped(text: &str) -> String {
    text.chars().map(|letter| escape_of(letter).unwrap_or_else(|| "_".into())).collect()
}

/// A letter as it is written to a file; `None` if this is not possible.
fn escape_of(letter: char) -> Option<String> {
    match letter {
        ' '..='~' => Some(letter.into()),
        '\u{a0}'..='\u{ffff}' => Some(format!("\\U+{:04X}", u32::from(letter))),
        _ => None,
    }
}

/// A comment, split into lines that every reader accepts (AutoCAD's limit is 255 characters).
pub(super) fn comment_lines(comment: &str) -> Vec<String> {
    let mut lines = Vec::new();
    for paragraph in comment.lines() {
        let mut line = String::new();
        for letter in paragraph.chars() {
            if line.len() > 200 {
                lines.push(std::mem::take(&mut line));
            }
            line += &escaped(letter.encode_utf8(&mut [0; 4]));
        }
        lines.push(line);
    }
    lines
}

/// The layers' names as they are written in the file.
pub(super) fn layer_names(layers: &[Layer], profile: DxfProfile) -> Vec<String> {
    plain_layer_names(layers, profile).iter().map(|name| escaped(name)).collect()
}

/// The layers' names as the profile can represent them, all different, before escaping.
pub(super) fn plain_layer_names(layers: &[Layer], profile: DxfProfile) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let mut unique = |name: String, limit: usize| {
        let mut candidate = name.clone();
        let mut number = 2;
        // Names are not case-sensitive, as in AutoCAD.
        while !taken.insert(candidate.to_uppercase()) {
            let suffix = format!("_{number}");
            let kept: String = name.chars().take(limit - suffix.len()).collect();
            candidate = kept + &suffix;
            number += 1;
        }
        candidate
    };
    let names = layers.iter().map(|layer| {
        let clean = |letter: char| match profile {
            DxfProfile::R12 | DxfProfile::R12Lines => {
                letter.is_ascii_alphanumeric() || matches!(letter, '$' | '-' | '_')
            }
            DxfProfile::R2000 => escape_of(letter).is_some() && !"<>/\\\":;?*|=,`'^".contains(letter),
        };
        let limit = if profile.is_r12() { 31 } else { 255 };
        let name: String = layer.name.trim().chars().map(|l| if clean(l) { l } else { '_' }).collect();
        let name: String = name.chars().take(limit).collect();
        unique(if name.is_empty() { "_".into() } else { name }, limit)
    });
    names.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_no_trailing_zeros_and_no_minus_zero() {
        for (value, text) in [
            (0.0, "0.0"),
            (-0.0, "0.0"),
            (-1e-9, "0.0"),
            (12.5, "12.5"),
            (-3.0, "-3.0"),
            (1.0 / 3.0, "0.333333"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn data_that_a_profile_cannot_represent_is_reported() {
        let rgb = Color::Rgb { aci: 30, rgb: [255, 128, 0] };
        let layer = |name: &str, color| Layer { name: name.into(), color };
        let layers = vec![layer("Größe", Color::Aci(1)), layer("MARK", rgb)];
        let drawing = MarkingDrawing { layers, ..MarkingDrawing::default() };
        assert_eq!(losses(&drawing, DxfProfile::R2000), []);
        let notices = losses(&drawing, DxfProfile::R12);
        assert!(notices.len() == 2 && notices[0].message.contains("Größe is Gr__e"), "{notices:?}");
        assert!(notices[1].message.contains("replaced colours: 1"), "{notices:?}");
    }

    #[test]
    fn layer_names_are_unique_and_valid() {
        let layer = |name: &str| Layer { name: name.into(), color: Color::Aci(1) };
        let layers = [layer("Größe"), layer("a|b"), layer("A/B"), layer(""), layer("0")];
        let r2000 = layer_names(&layers, DxfProfile::R2000);
        assert_eq!(r2000, ["Gr\\U+00F6\\U+00DFe", "a_b", "A_B_2", "_", "0"]);
        let r12 = layer_names(&layers, DxfProfile::R12);
        assert_eq!(r12, ["Gr__e", "a_b", "A_B_2", "_", "0"]);
    }
}
