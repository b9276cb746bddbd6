//! The properties of elements: attributes, style sheets and inheritance (SVG 1.1, chapter 6).

use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::str::FromStr;

use i_overlay::core::fill_rule::FillRule;
use kurbo::{Cap, Join};
use nalgebra::Vector2;
use roxmltree::{Document, Node, NodeType};
use svgtypes::PaintFallback;

use super::super::error::{EntityName, PatternReadError};
use super::super::font::{ASCENDER, DESCENDER};
use super::css::{self, Sheet};
use super::document::attribute;
use super::length::{Length, Scale, Unit, number_of};
use super::selector::Steps;
use super::syntax::Truth;
use super::variables::{Variables, resolved};

/// Default size of letters: `medium`, in user units.
const FONT_SIZE: f64 = 16.0;

/// What an area or a stroke is painted with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Paint {
    None,
    Color {
        rgb: [u8; 3],
        alpha: f64,
    },
    /// A gradient or pattern; it has no single colour.
    Server,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// The properties of an element that matter to a laser.
#[derive(Debug, Clone)]
pub(super) struct Style {
    // Inherited.
    pub(super) fill: Paint,
    pub(super) fill_alpha: f64,
    pub(super) fill_rule: FillRule,
    pub(super) clip_rule: FillRule,
    pub(super) stroke: Paint,
    pub(super) stroke_alpha: f64,
    /// Width of the stroke in the units of the element.
    pub(super) stroke_width: f64,
    pub(super) dashes: Rc<[f64]>,
    pub(super) dash_offset: f64,
    pub(super) cap: Cap,
    pub(super) join: Join,
    pub(super) miter_limit: f64,
    pub(super) visible: bool,
    pub(super) color: [u8; 3],
    pub(super) has_markers: bool,
    pub(super) font_size: f64,
    pub(super) font_family: Rc<str>,
    pub(super) is_bold: bool,
    pub(super) is_italic: bool,
    /// How narrow or wide the font is, if it is not normal.
    pub(super) stretch: Rc<str>,
    pub(super) is_kerned: bool,
    pub(super) has_ligatures: bool,
    pub(super) anchor: Anchor,
    pub(super) letter_spacing: f64,
    pub(super) keeps_blanks: bool,
    pub(super) is_vertical: bool,
    pub(super) is_right_to_left: bool,
    pub(super) word_spacing: f64,
    pub(super) letter_case: LetterCase,
    /// The area and the stroke of the element that copies this one, for `context-fill` and `context-stroke`.
    pub(super) context_paints: [Paint; 2],
    /// Lines along a text, with the style of the element that has them.
    pub(super) decorations: Rc<[(Decoration, Rc<Style>)]>,
    /// How far the letters are above the line, in user units.
    pub(super) raised: f64,
    dominant_baseline: Baseline,
    /// Size of the letters of the outermost element.
    root_font_size: f64,
    /// Custom properties.
    variables: Rc<Variables>,
    /// Properties that could not be read, with the reasons; some are of the element itself.
    unread: Rc<BTreeMap<String, String>>,
    /// The ids of the gradients and patterns of the drawing.
    servers: Rc<BTreeSet<String>>,
    // Of the element itself.
    pub(super) opacity: f64,
    pub(super) displayed: bool,
    pub(super) clip: Option<Rc<str>>,
    pub(super) mask: Option<Rc<str>>,
    pub(super) filter: bool,
    pub(super) transform: Option<Rc<str>>,
    /// The transform is written in CSS, with units.
    pub(super) is_css_transform: bool,
    pub(super) transform_origin: Option<Rc<str>>,
    /// The transform refers to the element's own bounds.
    pub(super) has_own_box: bool,
    /// CSS moves the element by other properties than `transform`.
    pub(super) is_moved_by_css: bool,
    /// CSS clips the element by a shape instead of a clip path.
    pub(super) has_css_clip: bool,
    /// A nested drawing shows what is outside its edges.
    pub(super) overflows: bool,
    /// Sizes and positions that CSS gives instead of attributes.
    geometry: Rc<[(Rc<str>, Rc<str>)]>,
    /// The width of the stroke is in units of the page.
    pub(super) fixed_width: bool,
    pub(super) baseline: Baseline,
}

/// Which height of the letters is at the text's position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Baseline {
    Alphabetic,
    Middle,
    Central,
    Mathematical,
    Hanging,
    Above,
    Below,
}

/// A line along a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Decoration {
    Underline,
    Overline,
    LineThrough,
}

/// What CSS makes of the letters of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LetterCase {
    AsWritten,
    Upper,
    Lower,
    /// Capitals of several sizes, or at the beginnings of words.
    Unread,
}

impl Default for Style {
    fn default() -> Self {
        Self {
            fill: Paint::Color { rgb: [0; 3], alpha: 1.0 },
            fill_alpha: 1.0,
            fill_rule: FillRule::NonZero,
            clip_rule: FillRule::NonZero,
            stroke: Paint::None,
            stroke_alpha: 1.0,
            stroke_width: 1.0,
            dashes: Rc::new([]),
            dash_offset: 0.0,
            cap: Cap::Butt,
            join: Join::Miter,
            miter_limit: 4.0,
            visible: true,
            color: [0; 3],
            has_markers: false,
            font_size: FONT_SIZE,
            font_family: "sans-serif".into(),
            is_bold: false,
            is_italic: false,
            stretch: "".into(),
            is_kerned: true,
            has_ligatures: true,
            anchor: Anchor::Start,
            letter_spacing: 0.0,
            keeps_blanks: false,
            is_vertical: false,
            is_right_to_left: false,
            word_spacing: 0.0,
            letter_case: LetterCase::AsWritten,
            context_paints: [Paint::None; 2],
            decorations: Rc::new([]),
            raised: 0.0,
            dominant_baseline: Baseline::Alphabetic,
            root_font_size: FONT_SIZE,
            variables: Rc::default(),
            unread: Rc::default(),
            servers: Rc::default(),
            opacity: 1.0,
            displayed: true,
            clip: None,
            mask: None,
            filter: false,
            transform: None,
            is_css_transform: false,
            transform_origin: None,
            has_own_box: false,
            is_moved_by_css: false,
            has_css_clip: false,
            overflows: false,
            geometry: Rc::new([]),
            fixed_width: false,
            baseline: Baseline::Alphabetic,
        }
    }
}

/// What a property has an effect on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Areas and strokes; children inherit it.
    Paint,
    /// Texts; children inherit it.
    Text,
    /// Texts, and only the element itself.
    OwnText,
    /// The element itself with all that is inside.
    Own,
    /// The size or position of the element itself, if it has one.
    Geometry,
}

impl Kind {
    fn is_inherited(self) -> bool {
        matches!(self, Self::Paint | Self::Text)
    }
}

/// What a property has an effect on; nothing if it cannot change a mark.
fn kind(name: &str) -> Option<Kind> {
    Some(match name {
        "fill" | "fill-opacity" | "fill-rule" | "clip-rule" | "stroke" | "stroke-opacity"
        | "stroke-width" | "stroke-dasharray" | "stroke-dashoffset" | "stroke-linecap"
        | "stroke-linejoin" | "stroke-miterlimit" | "visibility" | "color" | "marker" | "marker-start"
        | "marker-mid" | "marker-end" => Kind::Paint,
        "font" | "font-size" | "text-anchor" | "letter-spacing" | "word-spacing" | "text-transform"
        | "font-variant" | "font-variant-caps" | "white-space" | "writing-mode" | "direction"
        | "dominant-baseline" => Kind::Text,
        "baseline-shift" | "alignment-baseline" | "text-decoration" | "text-decoration-line" => Kind::OwnText,
        "opacity" | "display" | "clip-path" | "mask" | "mask-image" | "filter" | "transform"
        | "transform-origin" | "transform-box" | "translate" | "rotate" | "scale" | "offset"
        | "offset-path" | "overflow" | "vector-effect" | "zoom" | "all" => Kind::Own,
        name if GEOMETRY.contains(&name) => Kind::Geometry,
        _ => return None,
    })
}

/// Sizes and positions that CSS may give.
const GEOMETRY: [&str; 14] = [
    "cx",
    "cy",
    "r",
    "rx",
    "ry",
    "x",
    "y",
    "width",
    "height",
    "d",
    "min-width",
    "max-width",
    "min-height",
    "max-height",
];

/// What became of a declaration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outcome {
    Done,
    /// No value of this property: every program ignores it.
    Ignored,
    /// It may have a meaning, but is not read.
    Unread,
}

/// The outcome of a value that is not read: single words are all known, others may be functions or units that are not.
fn unless_word(value: &str) -> Outcome {
    let is_word = value.chars().all(|letter| letter.is_ascii_alphabetic() || letter == '-');
    let is_color = SYSTEM_COLORS.iter().any(|name| name.eq_ignore_ascii_case(value));
    if is_word && !is_color { Outcome::Ignored } else { Outcome::Unread }
}

/// Colours of the computer that shows a drawing (CSS Color Level 4, chapter 10 and appendix A).
const SYSTEM_COLORS: [&str; 42] = [
    "AccentColor",
    "AccentColorText",
    "ActiveText",
    "ButtonBorder",
    "ButtonFace",
    "ButtonText",
    "Canvas",
    "CanvasText",
    "Field",
    "FieldText",
    "GrayText",
    "Highlight",
    "HighlightText",
    "LinkText",
    "Mark",
    "MarkText",
    "SelectedItem",
    "SelectedItemText",
    "VisitedText",
    "ActiveBorder",
    "ActiveCaption",
    "AppWorkspace",
    "Background",
    "ButtonHighlight",
    "ButtonShadow",
    "CaptionText",
    "InactiveBorder",
    "InactiveCaption",
    "InactiveCaptionText",
    "InfoBackground",
    "InfoText",
    "Menu",
    "MenuText",
    "Scrollbar",
    "ThreeDDarkShadow",
    "ThreeDFace",
    "ThreeDHighlight",
    "ThreeDLightShadow",
    "ThreeDShadow",
    "Window",
    "WindowFrame",
    "WindowText",
];

/// A declaration of an element, from its attributes, a style sheet, or its attribute `style`.
struct Given<'s> {
    name: &'s str,
    value: &'s str,
    is_css: bool,
    /// The rule of the declaration, if it is not known whether it is one for the element.
    uncertain: Option<&'s str>,
}

/// Elements that areas and strokes may be painted with.
const PAINT_SERVERS: [&str; 8] = [
    "linearGradient",
    "radialGradient",
    "pattern",
    "hatch",
    "meshgradient",
    "meshGradient",
    "solidColor",
    "solidcolor",
];

/// The sheets of a drawing.
pub(super) struct Sheets {
    sheet: Sheet,
    /// The ids of the gradients and patterns of the drawing.
    servers: Rc<BTreeSet<String>>,
    steps: Steps,
}

/// Matching the selectors takes too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TooManySelectors;

impl TooManySelectors {
    pub(super) fn at(self, entity: EntityName) -> PatternReadError {
        let what = "comparisons with the selectors of its style sheets";
        PatternReadError::TooMany { what, limit: 20_000_000, entity: Some(entity) }
    }
}

impl Sheets {
    pub(super) fn of(document: &Document<'_>) -> Self {
        let mut sheet = Sheet::default();
        for node in document.root().children().filter(|node| node.node_type() == NodeType::PI) {
            let value = node.pi().filter(|pi| pi.target == "xml-stylesheet").and_then(|pi| pi.value);
            sheet.imports.extend(value.map(|value| value.chars().take(100).collect()));
        }
        for node in document.descendants().filter(|node| is_svg(*node) && node.tag_name().name() == "style") {
            let is_css = attribute(node, "type")
                .is_none_or(|kind| kind.trim().is_empty() || kind.trim().eq_ignore_ascii_case("text/css"));
            if is_css {
                let text: String = node.children().filter_map(|child| child.text()).collect();
                sheet.add(&text, attribute(node, "media").unwrap_or_default());
            }
        }
        sheet.sort();
        let servers = document.descendants().filter(|node| PAINT_SERVERS.contains(&node.tag_name().name()));
        let servers = servers.filter_map(|node| attribute(node, "id")).map(str::to_owned).collect();
        Self { sheet, servers: Rc::new(servers), steps: Steps::default() }
    }

    /// Style sheets in other files, which are not read.
    pub(super) fn imports(&self) -> &[String] {
        &self.sheet.imports
    }

    /// The style of an element inside one with the style `outer`.
    pub(super) fn style(
        &self,
        node: Node<'_, '_>,
        outer: &Style,
        viewport: Vector2<f64>,
    ) -> Result<Style, TooManySelectors> {
        let mut style = Style {
            servers: Rc::clone(&self.servers),
            opacity: 1.0,
            displayed: true,
            clip: None,
            mask: None,
            filter: false,
            transform: None,
            transform_origin: None,
            has_own_box: false,
            is_moved_by_css: false,
            has_css_clip: false,
            overflows: false,
            geometry: Rc::new([]),
            fixed_width: false,
            baseline: outer.dominant_baseline,
            ..outer.clone()
        };
        if !style.unread.is_empty() {
            let is_inherited = |name: &str| kind(name).is_some_and(Kind::is_inherited);
            Rc::make_mut(&mut style.unread).retain(|name, _| is_inherited(name));
        }
        let inline = css::declarations(attribute(node, "style").unwrap_or_default());
        let given = self.given(node, &inline)?;
        style.variables = outer.variables.with(
            given
                .iter()
                .filter(|given| given.name.starts_with("--"))
                .map(|given| (given.name, given.value, given.uncertain.is_some())),
        );
        // Other lengths and colours may refer to these. `font` resets the other properties of fonts, in their order.
        let is_first = |name: &str| name.starts_with("font") || name == "color";
        for first in [true, false] {
            for given in given.iter().filter(|given| is_first(given.name) == first) {
                style.declare(outer, given, viewport);
            }
            if first && node.parent_element().is_none() {
                style.root_font_size = style.font_size;
            }
        }
        let is_text = |node: Node<'_, '_>| node.tag_name().name() == "text";
        let is_raised = match node.tag_name().name() {
            "text" | "tspan" => true,
            "a" => node.ancestors().any(is_text),
            _ => false,
        };
        if !is_raised {
            style.raised = outer.raised;
        }
        let is_decoration =
            |given: &&Given<'_>| DECORATIONS.contains(&given.name) && given.uncertain.is_none();
        if let Some(given) = given.iter().rev().find(is_decoration)
            && let Ok(value) = resolved(given.value, &style.variables)
        {
            style.decorate(&value.unwrap_or_default());
        }
        Ok(style)
    }

    /// The declarations of an element, those that win last.
    fn given<'s>(
        &'s self,
        node: Node<'s, '_>,
        inline: &'s [css::Declaration],
    ) -> Result<Vec<Given<'s>>, TooManySelectors> {
        let mut given: Vec<Given<'_>> = Vec::new();
        let mut important: Vec<(usize, Given<'_>)> = Vec::new();
        for attribute in node.attributes() {
            let is_xml_space =
                attribute.namespace() == Some(roxmltree::NS_XML_URI) && attribute.name() == "space";
            if attribute.namespace().is_none() || is_xml_space {
                let name = if is_xml_space { "xml:space" } else { attribute.name() };
                given.push(Given { name, value: attribute.value(), is_css: false, uncertain: None });
            }
        }
        let mut add = |declaration: &'s css::Declaration, layer: usize, uncertain: Option<&'s str>| {
            let one = Given { name: &declaration.name, value: &declaration.value, is_css: true, uncertain };
            match declaration.is_important {
                true => important.push((layer, one)),
                false => given.push(one),
            }
        };
        for rule in &self.sheet.rules {
            let holds = rule.condition.min(rule.selector.matches(node, &self.steps));
            if holds != Truth::No {
                self.steps.add(rule.declarations.len());
                let uncertain = (holds == Truth::Unknown).then_some(&*rule.text);
                rule.declarations.iter().for_each(|declaration| add(declaration, rule.layer, uncertain));
            }
        }
        if self.steps.are_too_many() {
            return Err(TooManySelectors);
        }
        // Between important declarations, the earlier layer wins.
        inline.iter().for_each(|declaration| add(declaration, usize::MIN, None));
        important.sort_by_key(|(layer, _)| Reverse(*layer));
        given.extend(important.into_iter().map(|(_, one)| one));
        Ok(given)
    }
}

/// Whether an element belongs to SVG; files without a namespace are read as SVG, too.
pub(super) fn is_svg(node: Node<'_, '_>) -> bool {
    node.is_element() && node.tag_name().namespace().is_none_or(|name| name == "http://www.w3.org/2000/svg")
}

/// The id in `url(#id)`.
fn reference(value: &str) -> Option<Rc<str>> {
    let inside = value.strip_prefix("url(")?.split(')').next()?;
    let id = inside.trim().trim_matches(['"', '\'']).trim().strip_prefix('#')?;
    Some(id.into())
}

/// Shapes of CSS that can clip an element.
const CSS_SHAPES: [&str; 7] = ["inset(", "circle(", "ellipse(", "polygon(", "path(", "rect(", "xywh("];

fn baseline(value: &str) -> Option<Baseline> {
    match value {
        "auto" | "alphabetic" | "baseline" => Some(Baseline::Alphabetic),
        "middle" => Some(Baseline::Middle),
        "central" => Some(Baseline::Central),
        "mathematical" => Some(Baseline::Mathematical),
        "hanging" => Some(Baseline::Hanging),
        "text-before-edge" | "before-edge" | "text-top" => Some(Baseline::Above),
        "text-after-edge" | "after-edge" | "text-bottom" | "ideographic" => Some(Baseline::Below),
        _ => None,
    }
}

fn alpha(value: &str) -> Option<f64> {
    let number = match value.strip_suffix('%') {
        Some(percent) => number_of(percent)? / 100.0,
        None => number_of(value)?,
    };
    Some(number.clamp(0.0, 1.0))
}

/// A colour as a function of older standards, which have commas and no percentage as opacity: `rgb(1 2 3 / 4%)` is
/// `rgba(1,2,3,0.04)` there.
fn with_commas(value: &str) -> Cow<'_, str> {
    let parts = value.split_once('(').and_then(|(name, rest)| Some((name, rest.strip_suffix(')')?)));
    let Some((name @ ("rgb" | "rgba" | "hsl" | "hsla"), inside)) = parts else { return Cow::Borrowed(value) };
    let words = inside.split([',', '/', ' ', '\t', '\n']).filter(|word| !word.is_empty());
    let mut words: Vec<Cow<'_, str>> = words.map(Cow::Borrowed).collect();
    let mut name = name[..3].to_owned();
    if let [_, _, _, last] = &mut words[..] {
        name.push('a');
        if let Some(number) = alpha(last) {
            *last = number.to_string().into();
        }
    }
    Cow::Owned(format!("{name}({})", words.join(",")))
}

fn color(value: &str) -> Option<([u8; 3], f64)> {
    let color = svgtypes::Color::from_str(&with_commas(value)).ok()?;
    Some(([color.red, color.green, color.blue], f64::from(color.alpha) / 255.0))
}

/// The lines along a text, under their old and their new name.
const DECORATIONS: [&str; 2] = ["text-decoration", "text-decoration-line"];

impl Style {
    /// A size or position that CSS gives instead of an attribute.
    pub(super) fn geometry(&self, name: &str) -> Option<&str> {
        self.geometry.iter().rev().find(|(given, _)| &**given == name).map(|(_, value)| &**value)
    }

    /// What lengths of the element refer to, with what 100 % is.
    pub(super) fn scale(&self, whole: f64) -> Scale {
        Scale { font_size: self.font_size, root_font_size: self.root_font_size, whole }
    }

    /// A length of the element in user units; `None` if the text is none, or refers to a size that is not known.
    pub(super) fn length(&self, text: &str, whole: f64) -> Option<f64> {
        let length = Length::parsed(text)?;
        let is_relative = matches!(length.unit, Unit::Em | Unit::Ex);
        let is_known =
            !is_relative || !["font", "font-size"].iter().any(|name| self.unread.contains_key(*name));
        Some(length.user_units(self.scale(whole))).filter(|size| is_known && size.is_finite())
    }

    /// Why the element with all that is inside cannot be drawn.
    pub(super) fn unread_own(&self) -> Option<&str> {
        self.unread_of(|name| kind(name) == Some(Kind::Own))
    }

    /// Why a text with this style cannot be drawn.
    pub(super) fn unread_text(&self) -> Option<&str> {
        self.unread_of(|name| matches!(kind(name), Some(Kind::Text | Kind::OwnText)))
    }

    /// Why it is not known whether a shape is visible.
    pub(super) fn unread_visibility(&self) -> Option<&str> {
        self.unread.get("visibility").map(String::as_str)
    }

    /// Why the area or the stroke of a visible shape cannot be drawn.
    pub(super) fn unread_paint(&self, has_fill: bool, has_stroke: bool) -> Option<&str> {
        self.unread_of(|name| match name {
            "fill" | "stroke" => true,
            "fill-opacity" | "fill-rule" => has_fill,
            name => has_stroke && (name.starts_with("stroke") || name.starts_with("marker")),
        })
    }

    /// Why the area of a clip path cannot be drawn.
    pub(super) fn is_clip_unread(&self) -> bool {
        let matters =
            |name: &str| kind(name) == Some(Kind::Own) || matches!(name, "visibility" | "clip-rule");
        self.unread_of(matters).is_some()
    }

    /// Why a size or position is not known.
    pub(super) fn unread_geometry(&self, name: &str) -> Option<&str> {
        self.unread.get(name).map(String::as_str)
    }

    fn unread_of(&self, matters: impl Fn(&str) -> bool) -> Option<&str> {
        self.unread.iter().find(|(name, _)| matters(name)).map(|(_, why)| why.as_str())
    }

    fn note_unread(&mut self, name: &str, why: String) {
        Rc::make_mut(&mut self.unread).insert(name.to_owned(), why);
    }

    /// Applies a declaration, or notes why it cannot be read.
    fn declare(&mut self, outer: &Self, given: &Given<'_>, viewport: Vector2<f64>) {
        let name = given.name;
        let is_geometry = GEOMETRY.contains(&name);
        // Attributes of sizes are no properties; `rotate`, `scale` and others mean something else.
        let is_property = given.is_css || !(is_geometry || MOVES.contains(&name) || SHAPING.contains(&name));
        let matters = kind(name).is_some();
        // These change what is reported or only details of the letters, or are no properties of CSS.
        let is_read = matters
            || SHAPING.contains(&name)
            || matches!(
                name,
                "font-family"
                    | "font-weight"
                    | "font-style"
                    | "font-stretch"
                    | "text-rendering"
                    | "xml:space"
            );
        if !is_property || !is_read {
            return;
        }
        if let (Some(rule), true) = (given.uncertain, matters) {
            let why = format!(
                "the rule `{rule}` of the style sheet cannot be evaluated, and may set its `{name}`: set it in the element, or \
                 export the drawing as plain SVG"
            );
            return self.note_unread(name, why);
        }
        if given.uncertain.is_some() {
            return;
        }
        let value = given.value.trim();
        let outcome = match resolved(value, &self.variables) {
            Ok(Some(value)) => self.apply(outer, given, value.trim(), viewport),
            Ok(None) => self.apply(outer, given, "unset", viewport),
            Err(_) => Outcome::Unread,
        };
        match outcome {
            Outcome::Done if self.unread.contains_key(name) => {
                Rc::make_mut(&mut self.unread).remove(name);
            }
            Outcome::Unread if matters => {
                let value: String = value.chars().take(60).collect();
                let why = format!(
                    "its `{name}` of `{value}` cannot be read: give it a plain value, or export the drawing as plain SVG"
                );
                self.note_unread(name, why);
            }
            _ => {}
        }
    }

    fn decorate(&mut self, value: &str) {
        let kinds = [
            ("underline", Decoration::Underline),
            ("overline", Decoration::Overline),
            ("line-through", Decoration::LineThrough),
        ];
        let found = kinds.iter().filter(|(name, _)| value.split_whitespace().any(|word| word == *name));
        let found: Vec<Decoration> = found.map(|(_, kind)| *kind).collect();
        if found.is_empty() {
            return;
        }
        let by = Rc::new(Self { decorations: Rc::new([]), ..self.clone() });
        let own = found.into_iter().map(|kind| (kind, by.clone()));
        self.decorations = self.decorations.iter().cloned().chain(own).collect();
    }

    fn apply(&mut self, outer: &Self, given: &Given<'_>, value: &str, viewport: Vector2<f64>) -> Outcome {
        let name = given.name;
        let lower = value.to_ascii_lowercase();
        let word = lower.as_str();
        if value.is_empty() {
            return Outcome::Ignored;
        }
        let is_inherited = kind(name).is_none_or(Kind::is_inherited);
        // The style that a keyword of CSS takes the value from.
        let source = match word {
            "inherit" => Some(Cow::Borrowed(outer)),
            "unset" | "revert" if is_inherited => Some(Cow::Borrowed(outer)),
            "initial" | "unset" | "revert" => Some(Cow::Owned(Self::default())),
            "revert-layer" => return Outcome::Unread,
            _ => None,
        };
        let diagonal = viewport.norm() / 2.0_f64.sqrt();
        let font_size = self.font_size;
        macro_rules! set {
            ($field:ident, $value:expr) => {
                if let Some(source) = &source {
                    self.$field = source.$field.clone();
                } else {
                    match $value {
                        Some(value) => self.$field = value,
                        None => return unless_word(value),
                    }
                }
            };
        }
        let spacing = |style: &Self, word: &str| match word {
            "normal" => Some(0.0),
            word => style.length(word, font_size),
        };
        let rule = || match word {
            "evenodd" => Some(FillRule::EvenOdd),
            "nonzero" => Some(FillRule::NonZero),
            _ => None,
        };
        match name {
            "fill" => set!(fill, self.paint(value)),
            "stroke" => set!(stroke, self.paint(value)),
            "fill-opacity" => set!(fill_alpha, alpha(value)),
            "stroke-opacity" => set!(stroke_alpha, alpha(value)),
            "fill-rule" => set!(fill_rule, rule()),
            "clip-rule" => set!(clip_rule, rule()),
            "stroke-width" => set!(stroke_width, self.length(word, diagonal).filter(|width| *width >= 0.0)),
            "stroke-dasharray" => set!(dashes, {
                let parts = word.split([',', ' ', '\t', '\n', '\r']);
                let parts = parts.filter(|part| !part.is_empty() && *part != "none");
                let all: Option<Vec<f64>> =
                    parts.map(|part| self.length(part, diagonal).filter(|dash: &f64| *dash >= 0.0)).collect();
                all.map(|dashes| if dashes.iter().sum::<f64>() > 0.0 { dashes } else { Vec::new() }.into())
            }),
            "stroke-dashoffset" => set!(dash_offset, self.length(word, diagonal)),
            "stroke-linecap" => set!(
                cap,
                match word {
                    "butt" => Some(Cap::Butt),
                    "round" => Some(Cap::Round),
                    "square" => Some(Cap::Square),
                    _ => None,
                }
            ),
            "stroke-linejoin" => set!(
                join,
                match word {
                    "miter" | "miter-clip" | "arcs" => Some(Join::Miter),
                    "round" => Some(Join::Round),
                    "bevel" => Some(Join::Bevel),
                    _ => None,
                }
            ),
            "stroke-miterlimit" => set!(miter_limit, number_of(value).filter(|limit| *limit >= 1.0)),
            "visibility" => set!(
                visible,
                match word {
                    "visible" => Some(true),
                    "hidden" | "collapse" => Some(false),
                    _ => None,
                }
            ),
            "color" => match color(word) {
                None if word == "currentcolor" => self.color = outer.color,
                found => set!(color, found.map(|(rgb, _)| rgb)),
            },
            "marker" | "marker-start" | "marker-mid" | "marker-end" => {
                set!(has_markers, Some(word != "none" || (name != "marker" && self.has_markers)));
            }
            "font-size" => {
                let outer_scale = Scale { whole: outer.font_size, ..outer.scale(0.0) };
                set!(
                    font_size,
                    match word {
                        "medium" => Some(FONT_SIZE),
                        "xx-small" => Some(FONT_SIZE * 0.6),
                        "x-small" => Some(FONT_SIZE * 0.75),
                        "small" => Some(FONT_SIZE * 8.0 / 9.0),
                        "large" => Some(FONT_SIZE * 1.2),
                        "x-large" => Some(FONT_SIZE * 1.5),
                        "xx-large" => Some(FONT_SIZE * 2.0),
                        "xxx-large" => Some(FONT_SIZE * 3.0),
                        "larger" => Some(outer.font_size * 1.2),
                        "smaller" => Some(outer.font_size / 1.2),
                        _ => Length::parsed(word)
                            .map(|length| length.user_units(outer_scale))
                            .filter(|size| size.is_finite() && *size >= 0.0),
                    }
                );
            }
            "font-family" => set!(font_family, Some(value.into())),
            "font-weight" => set!(
                is_bold,
                Some(
                    matches!(word, "bold" | "bolder")
                        || value.parse::<f64>().is_ok_and(|weight| weight >= 600.0)
                )
            ),
            "font-style" => set!(is_italic, Some(word == "italic" || word.starts_with("oblique"))),
            "font-stretch" => set!(stretch, Some(stretch(word))),
            "font-kerning" => set!(
                is_kerned,
                match word {
                    "none" => Some(false),
                    "auto" | "normal" => Some(true),
                    _ => None,
                }
            ),
            "font-variant-ligatures" => set!(has_ligatures, Some(has_ligatures(word))),
            "font-feature-settings" => {
                self.is_kerned &= !is_feature_off(word, "kern");
                self.has_ligatures &= !is_feature_off(word, "liga");
            }
            // Browsers leave out ligatures for speed, but not the kerning.
            "text-rendering" => self.has_ligatures &= word != "optimizespeed",
            "font" => {
                // `bold 12px/1.2 Arial`: the size is the first length, the family follows it.
                let words: Vec<&str> = value.split_whitespace().collect();
                let size = |word: &&str| {
                    let word = word.split('/').next().unwrap_or(word);
                    Length::parsed(word).is_some_and(|length| length.unit != Unit::None)
                };
                if source.is_some() {
                    set!(font_size, None);
                    set!(font_family, None);
                    set!(is_bold, None);
                    set!(is_italic, None);
                    set!(stretch, None);
                    set!(is_kerned, None);
                    set!(has_ligatures, None);
                } else if let Some(at) = words.iter().position(size) {
                    self.is_bold = words.contains(&"bold");
                    self.is_italic = words.contains(&"italic");
                    let is_width = |word: &&str| word.ends_with("condensed") || word.ends_with("expanded");
                    let found = words[..at].iter().copied().find(is_width);
                    self.stretch = found.unwrap_or_default().into();
                    (self.is_kerned, self.has_ligatures) = (true, true);
                    self.font_family = words[at + 1..].join(" ").into();
                    let size = words[at].split('/').next().unwrap_or_default();
                    let of_size = Given { name: "font-size", ..*given };
                    return self.apply(outer, &of_size, size, viewport);
                } else {
                    return unless_word(value);
                }
            }
            "text-anchor" => set!(
                anchor,
                match word {
                    "start" => Some(Anchor::Start),
                    "middle" => Some(Anchor::Middle),
                    "end" => Some(Anchor::End),
                    _ => None,
                }
            ),
            "letter-spacing" => set!(letter_spacing, spacing(self, word)),
            "word-spacing" => set!(word_spacing, spacing(self, word)),
            "baseline-shift" => {
                // CSS leaves these heights open; in Chromium they are half the height of the element's own font.
                let half = font_size * (ASCENDER + DESCENDER) / 2.0;
                let shift = match word {
                    "sub" => Some(-half),
                    "super" => Some(half),
                    "top" | "center" | "bottom" => return Outcome::Unread,
                    word if word == "baseline" || source.is_some() => Some(0.0),
                    word => self.length(word, font_size),
                };
                match shift {
                    Some(shift) => self.raised = outer.raised + shift,
                    None => return unless_word(value),
                }
            }
            "text-transform" => set!(
                letter_case,
                Some(match word {
                    "uppercase" => LetterCase::Upper,
                    "lowercase" => LetterCase::Lower,
                    "capitalize" => LetterCase::Unread,
                    _ => LetterCase::AsWritten,
                })
            ),
            "font-variant" | "font-variant-caps" => {
                if name == "font-variant" {
                    set!(has_ligatures, Some(has_ligatures(word)));
                }
                let has_capitals = word.split_whitespace().any(|word| word.contains("caps"));
                set!(
                    letter_case,
                    Some(if has_capitals { LetterCase::Unread } else { LetterCase::AsWritten })
                );
            }
            "xml:space" => self.keeps_blanks = value == "preserve",
            "white-space" => {
                set!(keeps_blanks, Some(matches!(word, "pre" | "pre-wrap" | "break-spaces")));
            }
            "writing-mode" => {
                set!(is_vertical, Some(word.starts_with("tb") || word.starts_with("vertical")));
            }
            "direction" => set!(
                is_right_to_left,
                match word {
                    "ltr" => Some(false),
                    "rtl" => Some(true),
                    _ => None,
                }
            ),
            "opacity" => set!(opacity, alpha(value)),
            // Every other value of CSS draws the element; single words that are none are ignored.
            "display" => match word {
                _ if source.is_some() => set!(displayed, None),
                "none" => self.displayed = false,
                word if DISPLAYS.contains(&word) => self.displayed = true,
                _ => return unless_word(value),
            },
            "clip-path" => {
                let has_shape = CSS_SHAPES.iter().any(|shape| word.contains(shape));
                let clip = reference(value);
                set!(clip, (clip.is_some() || has_shape || word == "none").then_some(clip));
                set!(has_css_clip, Some(has_shape));
            }
            "mask" | "mask-image" => {
                let mask = reference(value);
                set!(mask, (mask.is_some() || word == "none").then_some(mask));
            }
            "overflow" => set!(overflows, Some(matches!(word, "visible" | "auto"))),
            "transform-origin" => set!(transform_origin, Some(Some(value.into()))),
            "transform-box" => set!(has_own_box, Some(word != "view-box")),
            "filter" => set!(filter, Some(word != "none")),
            "transform" => {
                set!(transform, Some(Some(value.into())));
                self.is_css_transform =
                    source.as_ref().map_or(given.is_css, |source| source.is_css_transform);
            }
            "vector-effect" => set!(fixed_width, Some(word == "non-scaling-stroke")),
            "dominant-baseline" => {
                set!(dominant_baseline, baseline(word));
                self.baseline = self.dominant_baseline;
            }
            "alignment-baseline" => set!(baseline, baseline(word)),
            "zoom" if matches!(word, "1" | "100%" | "normal") || source.is_some() => {}
            "all" | "zoom" => return Outcome::Unread,
            name if given.is_css && MOVES.contains(&name) => {
                self.is_moved_by_css = source.is_none() && !matches!(word, "none" | "0" | "1");
            }
            name if given.is_css && GEOMETRY.contains(&name) => {
                let given = (name.into(), value.into());
                self.geometry = self.geometry.iter().cloned().chain([given]).collect();
            }
            _ => {}
        }
        Outcome::Done
    }

    fn paint(&self, value: &str) -> Option<Paint> {
        let own = Paint::Color { rgb: self.color, alpha: 1.0 };
        let of = |color: svgtypes::Color| Paint::Color {
            rgb: [color.red, color.green, color.blue],
            alpha: f64::from(color.alpha) / 255.0,
        };
        // The names of references may have capitals; words and functions may be written with any.
        let lower = value.to_ascii_lowercase();
        let value = match lower.as_str() {
            "currentcolor" => "currentColor",
            other if other.starts_with("url(") => value,
            other => other,
        };
        let value = &*with_commas(value);
        Some(match svgtypes::Paint::from_str(value).ok()? {
            svgtypes::Paint::None => Paint::None,
            svgtypes::Paint::CurrentColor if self.unread.contains_key("color") => return None,
            svgtypes::Paint::CurrentColor => own,
            svgtypes::Paint::Color(color) => of(color),
            svgtypes::Paint::FuncIRI(id, _) if self.servers.contains(id) => Paint::Server,
            // What the file does not contain paints nothing, or with the colour that is named for this case.
            svgtypes::Paint::FuncIRI(_, None | Some(PaintFallback::None)) => Paint::None,
            svgtypes::Paint::FuncIRI(_, Some(PaintFallback::CurrentColor)) => own,
            svgtypes::Paint::FuncIRI(_, Some(PaintFallback::Color(color))) => of(color),
            svgtypes::Paint::ContextFill => self.context_paints[0],
            svgtypes::Paint::ContextStroke => self.context_paints[1],
            svgtypes::Paint::Inherit => return None,
        })
    }
}

/// How narrow or wide a font of this `font-stretch` is; empty if it is normal.
fn stretch(word: &str) -> Rc<str> {
    match word {
        "normal" | "100%" => "".into(),
        word => word.into(),
    }
}

/// Whether a value of `font-variant` or `font-variant-ligatures` keeps the usual ligatures.
fn has_ligatures(value: &str) -> bool {
    !value.split_whitespace().any(|word| matches!(word, "none" | "no-common-ligatures"))
}

/// Whether a value of `font-feature-settings` switches a feature off.
fn is_feature_off(value: &str, feature: &str) -> bool {
    value.split(',').any(|setting| {
        let (name, state) = setting.trim().split_once(char::is_whitespace).unwrap_or((setting.trim(), "1"));
        name.trim_matches(['"', '\'']) == feature && matches!(state.trim(), "0" | "off")
    })
}

/// Properties of CSS that are not attributes, and that define how letters are set side by side.
const SHAPING: [&str; 3] = ["font-kerning", "font-variant-ligatures", "font-feature-settings"];

/// Properties of CSS that move an element beside `transform`.
const MOVES: [&str; 5] = ["translate", "rotate", "scale", "offset", "offset-path"];

/// Values of `display` that draw an element.
const DISPLAYS: [&str; 24] = [
    "inline",
    "block",
    "contents",
    "flex",
    "grid",
    "inline-block",
    "inline-flex",
    "inline-grid",
    "flow-root",
    "list-item",
    "run-in",
    "compact",
    "marker",
    "flow",
    "ruby",
    "math",
    "table",
    "inline-table",
    "table-row-group",
    "table-header-group",
    "table-footer-group",
    "table-row",
    "table-cell",
    "table-caption",
];
