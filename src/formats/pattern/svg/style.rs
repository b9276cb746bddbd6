//! The properties of elements: attributes, style sheets and inheritance (SVG 1.1, chapter 6).

use std::cell::Cell;
use std::rc::Rc;
use std::str::FromStr;

use i_overlay::core::fill_rule::FillRule;
use kurbo::{Cap, Join};
use nalgebra::Vector2;
use roxmltree::{Document, Node};
use simplecss::{AttributeOperator, DeclarationTokenizer, Element, PseudoClass, StyleSheet};
use svgtypes::{Length, LengthUnit};

/// Largest number of steps for matching the selectors of style sheets.
const MAX_STEPS: usize = 20_000_000;
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
    pub(super) anchor: Anchor,
    pub(super) letter_spacing: f64,
    pub(super) keeps_blanks: bool,
    pub(super) is_vertical: bool,
    pub(super) word_spacing: f64,
    pub(super) letter_case: LetterCase,
    /// The area and the stroke of the element that copies this one, for `context-fill` and `context-stroke`.
    pub(super) context_paints: [Paint; 2],
    /// Lines along a text, with the style of the element that has them.
    pub(super) decorations: Rc<[(Decoration, Rc<Style>)]>,
    /// How far the letters are above the line, in user units.
    pub(super) raised: f64,
    dominant_baseline: Baseline,
    // Of the element itself.
    pub(super) opacity: f64,
    pub(super) displayed: bool,
    pub(super) clip: Option<Rc<str>>,
    pub(super) mask: Option<Rc<str>>,
    pub(super) filter: bool,
    pub(super) transform: Option<Rc<str>>,
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
            anchor: Anchor::Start,
            letter_spacing: 0.0,
            keeps_blanks: false,
            is_vertical: false,
            word_spacing: 0.0,
            letter_case: LetterCase::AsWritten,
            context_paints: [Paint::None; 2],
            decorations: Rc::new([]),
            raised: 0.0,
            dominant_baseline: Baseline::Alphabetic,
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
            baseline: Baseline::Alphabetic,
        }
    }
}

/// A length in user units. `whole` is what 100 % is.
pub(super) fn user_units(length: Length, font_size: f64, whole: f64) -> f64 {
    length.number
        * match length.unit {
            LengthUnit::None | LengthUnit::Px => 1.0,
            LengthUnit::Em => font_size,
            LengthUnit::Ex => font_size / 2.0,
            LengthUnit::In => 96.0,
            LengthUnit::Cm => 96.0 / 2.54,
            LengthUnit::Mm => 96.0 / 25.4,
            LengthUnit::Pt => 96.0 / 72.0,
            LengthUnit::Pc => 16.0,
            LengthUnit::Percent => whole / 100.0,
        }
}

/// The sheets of a drawing.
pub(super) struct Sheets<'d> {
    sheet: StyleSheet<'d>,
    steps: Cell<usize>,
}

/// Matching the selectors takes too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TooManySelectors;

impl<'d> Sheets<'d> {
    pub(super) fn of(document: &'d Document<'_>) -> Self {
        let mut sheet = StyleSheet::new();
        for node in document.descendants().filter(|node| is_svg(*node) && node.tag_name().name() == "style") {
            let is_css = node.attribute("type").is_none_or(|kind| kind.is_empty() || kind == "text/css");
            for text in node.children().filter(|_| is_css).filter_map(|child| child.text()) {
                sheet.parse_more(text);
            }
        }
        Self { sheet, steps: Cell::new(0) }
    }

    /// The style of an element inside one with the style `outer`.
    pub(super) fn style(
        &self,
        node: Node<'_, '_>,
        outer: &Style,
        viewport: Vector2<f64>,
    ) -> Result<Style, TooManySelectors> {
        let mut style = Style {
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
        let mut given: Vec<(&str, &str)> = Vec::new();
        let mut important: Vec<(&str, &str)> = Vec::new();
        for attribute in node.attributes() {
            let is_xml_space =
                attribute.namespace() == Some(roxmltree::NS_XML_URI) && attribute.name() == "space";
            if attribute.namespace().is_none() || is_xml_space {
                given.push((if is_xml_space { "xml:space" } else { attribute.name() }, attribute.value()));
            }
        }
        let attributes = given.len();
        let element = Matched { node, steps: &self.steps };
        for rule in self.sheet.rules.iter().filter(|rule| rule.selector.matches(&element)) {
            for declaration in &rule.declarations {
                let list = if declaration.important { &mut important } else { &mut given };
                list.push((declaration.name, declaration.value));
            }
        }
        if self.steps.get() > MAX_STEPS {
            return Err(TooManySelectors);
        }
        for declaration in DeclarationTokenizer::from(node.attribute("style").unwrap_or_default()) {
            let list = if declaration.important { &mut important } else { &mut given };
            list.push((declaration.name, declaration.value));
        }
        given.extend(important);
        // Other lengths and colours may refer to these.
        let is_first = |name: &str| matches!(name, "font" | "font-size" | "color");
        for first in [true, false] {
            for (name, value) in given.iter().filter(|(name, _)| is_first(name) == first) {
                style.apply(outer, name, value.trim(), viewport);
            }
        }
        for (name, value) in &given[attributes..] {
            style.apply_css(name, value.trim());
        }
        if node.tag_name().name() != "tspan" {
            style.raised = outer.raised;
        }
        if let Some((_, value)) = given.iter().rev().find(|(name, _)| DECORATIONS.contains(name)) {
            style.decorate(value);
        }
        Ok(style)
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
        "central" | "mathematical" => Some(Baseline::Central),
        "hanging" => Some(Baseline::Hanging),
        "text-before-edge" | "before-edge" | "text-top" => Some(Baseline::Above),
        "text-after-edge" | "after-edge" | "text-bottom" | "ideographic" => Some(Baseline::Below),
        _ => None,
    }
}

fn alpha(value: &str) -> Option<f64> {
    let number = match value.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().ok()? / 100.0,
        None => value.parse().ok()?,
    };
    Some(number.clamp(0.0, 1.0))
}

fn color(value: &str) -> Option<([u8; 3], f64)> {
    let color = svgtypes::Color::from_str(value).ok()?;
    Some(([color.red, color.green, color.blue], f64::from(color.alpha) / 255.0))
}

/// The lines along a text, under their old and their new name.
const DECORATIONS: [&str; 2] = ["text-decoration", "text-decoration-line"];

impl Style {
    /// A size or position that CSS gives instead of an attribute.
    pub(super) fn geometry(&self, name: &str) -> Option<&str> {
        self.geometry.iter().rev().find(|(given, _)| &**given == name).map(|(_, value)| &**value)
    }

    /// Properties that have no attribute, or an attribute with another meaning.
    fn apply_css(&mut self, name: &str, value: &str) {
        match name {
            "translate" | "rotate" | "scale" | "offset" | "offset-path" => {
                self.is_moved_by_css |= !matches!(value, "none" | "initial" | "0" | "1");
            }
            "cx" | "cy" | "r" | "rx" | "ry" | "x" | "y" | "width" | "height" => {
                let given = (name.into(), value.into());
                self.geometry = self.geometry.iter().cloned().chain([given]).collect();
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

    fn apply(&mut self, outer: &Self, name: &str, value: &str, viewport: Vector2<f64>) {
        let inherit = value == "inherit";
        let diagonal = viewport.norm() / 2.0_f64.sqrt();
        let font_size = self.font_size;
        let length = |value: &str, whole: f64| {
            Length::from_str(value)
                .ok()
                .map(|length| user_units(length, font_size, whole))
                .filter(|size| size.is_finite())
        };
        macro_rules! set {
            ($field:ident, $value:expr) => {
                if inherit {
                    self.$field = outer.$field.clone();
                } else if let Some(value) = $value {
                    self.$field = value;
                }
            };
        }
        let rule = || match value {
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
            "stroke-width" => set!(stroke_width, length(value, diagonal)),
            "stroke-dasharray" => set!(dashes, {
                let parts = value.split([',', ' ', '\t', '\n']).filter(|part| !part.is_empty());
                let all: Option<Vec<f64>> = parts.map(|part| length(part, diagonal)).collect();
                Some(all.filter(|dashes| {
                    dashes.iter().all(|dash| *dash >= 0.0) && dashes.iter().sum::<f64>() > 0.0
                }))
                .map(|dashes| dashes.unwrap_or_default().into())
            }),
            "stroke-dashoffset" => set!(dash_offset, length(value, diagonal)),
            "stroke-linecap" => set!(
                cap,
                match value {
                    "butt" => Some(Cap::Butt),
                    "round" => Some(Cap::Round),
                    "square" => Some(Cap::Square),
                    _ => None,
                }
            ),
            "stroke-linejoin" => set!(
                join,
                match value {
                    "miter" | "miter-clip" | "arcs" => Some(Join::Miter),
                    "round" => Some(Join::Round),
                    "bevel" => Some(Join::Bevel),
                    _ => None,
                }
            ),
            "stroke-miterlimit" => set!(miter_limit, value.parse().ok().filter(|limit: &f64| *limit >= 1.0)),
            "visibility" => set!(visible, Some(value == "visible")),
            "color" => set!(color, color(value).map(|(rgb, _)| rgb)),
            "marker" | "marker-start" | "marker-mid" | "marker-end" => {
                set!(has_markers, Some(value != "none" || (name != "marker" && self.has_markers)));
            }
            "font-size" => {
                let outer_size = outer.font_size;
                self.font_size = match value {
                    "medium" | "initial" => FONT_SIZE,
                    "xx-small" => FONT_SIZE * 0.6,
                    "x-small" => FONT_SIZE * 0.75,
                    "small" => FONT_SIZE * 8.0 / 9.0,
                    "large" => FONT_SIZE * 1.2,
                    "x-large" => FONT_SIZE * 1.5,
                    "xx-large" => FONT_SIZE * 2.0,
                    "larger" => outer_size * 1.2,
                    "smaller" => outer_size / 1.2,
                    _ => Length::from_str(value)
                        .ok()
                        .map(|length| user_units(length, outer_size, outer_size))
                        .filter(|size| size.is_finite() && *size >= 0.0)
                        .unwrap_or(outer_size),
                };
            }
            "font-family" => set!(font_family, Some(value.into())),
            "font-weight" => set!(
                is_bold,
                Some(
                    matches!(value, "bold" | "bolder")
                        || value.parse::<f64>().is_ok_and(|weight| weight >= 600.0)
                )
            ),
            "font-style" => set!(is_italic, Some(matches!(value, "italic") || value.starts_with("oblique"))),
            "font" => {
                // `bold 12px/1.2 Arial`: the size is the first length, the family follows it.
                let words: Vec<&str> = value.split_whitespace().collect();
                self.is_bold = words.contains(&"bold");
                self.is_italic = words.contains(&"italic");
                let size = |word: &&str| {
                    let word = word.split('/').next().unwrap_or(word);
                    word.starts_with(|first: char| first.is_ascii_digit() || first == '.')
                        && Length::from_str(word).is_ok_and(|length| length.unit != LengthUnit::None)
                };
                if let Some(at) = words.iter().position(size) {
                    self.apply(outer, "font-size", words[at].split('/').next().unwrap_or_default(), viewport);
                    self.font_family = words[at + 1..].join(" ").into();
                }
            }
            "text-anchor" => set!(
                anchor,
                match value {
                    "start" => Some(Anchor::Start),
                    "middle" => Some(Anchor::Middle),
                    "end" => Some(Anchor::End),
                    _ => None,
                }
            ),
            "letter-spacing" => set!(letter_spacing, Some(length(value, font_size).unwrap_or(0.0))),
            "word-spacing" => set!(word_spacing, Some(length(value, font_size).unwrap_or(0.0))),
            "baseline-shift" => {
                // DejaVu Sans: the heights of subscripts and superscripts in its table OS/2.
                self.raised = outer.raised
                    + match value {
                        "sub" => -font_size * 286.0 / 2048.0,
                        "super" => font_size * 983.0 / 2048.0,
                        _ => length(value, font_size).unwrap_or(0.0),
                    };
            }
            "text-transform" => set!(
                letter_case,
                Some(match value {
                    "uppercase" => LetterCase::Upper,
                    "lowercase" => LetterCase::Lower,
                    "capitalize" => LetterCase::Unread,
                    _ => LetterCase::AsWritten,
                })
            ),
            "font-variant" | "font-variant-caps" => {
                let has_capitals = value.split_whitespace().any(|word| word.contains("caps"));
                set!(
                    letter_case,
                    Some(if has_capitals { LetterCase::Unread } else { LetterCase::AsWritten })
                );
            }
            "xml:space" => self.keeps_blanks = value == "preserve",
            "white-space" => {
                set!(keeps_blanks, Some(matches!(value, "pre" | "pre-wrap" | "break-spaces")));
            }
            "writing-mode" => {
                set!(is_vertical, Some(value.starts_with("tb") || value.starts_with("vertical")));
            }
            "opacity" => set!(opacity, alpha(value)),
            "display" => set!(displayed, Some(value != "none")),
            "clip-path" => {
                set!(clip, Some(reference(value)));
                self.has_css_clip = CSS_SHAPES.iter().any(|shape| value.contains(shape));
            }
            "mask" | "mask-image" => set!(mask, Some(reference(value))),
            "overflow" => set!(overflows, Some(matches!(value, "visible" | "auto"))),
            "transform-origin" => set!(transform_origin, Some(Some(value.into()))),
            "transform-box" => set!(has_own_box, Some(value != "view-box")),
            "filter" => set!(filter, Some(value != "none" && !value.is_empty())),
            "transform" => set!(transform, Some(Some(value.into()))),
            "vector-effect" => set!(fixed_width, Some(value == "non-scaling-stroke")),
            "dominant-baseline" => {
                set!(dominant_baseline, baseline(value));
                self.baseline = self.dominant_baseline;
            }
            "alignment-baseline" => set!(baseline, baseline(value)),
            _ => {}
        }
    }

    fn paint(&self, value: &str) -> Option<Paint> {
        let own = Paint::Color { rgb: self.color, alpha: 1.0 };
        let of = |color: svgtypes::Color| Paint::Color {
            rgb: [color.red, color.green, color.blue],
            alpha: f64::from(color.alpha) / 255.0,
        };
        Some(match svgtypes::Paint::from_str(value).ok()? {
            svgtypes::Paint::None => Paint::None,
            svgtypes::Paint::CurrentColor => own,
            svgtypes::Paint::Color(color) => of(color),
            svgtypes::Paint::FuncIRI(..) => Paint::Server,
            svgtypes::Paint::ContextFill => self.context_paints[0],
            svgtypes::Paint::ContextStroke => self.context_paints[1],
            svgtypes::Paint::Inherit => return None,
        })
    }
}

/// An element that selectors are compared with; every comparison is counted.
struct Matched<'a, 'd, 'c> {
    node: Node<'a, 'd>,
    steps: &'c Cell<usize>,
}

impl Matched<'_, '_, '_> {
    fn step(&self) -> bool {
        self.steps.set(self.steps.get() + 1);
        self.steps.get() <= MAX_STEPS
    }
}

impl Element for Matched<'_, '_, '_> {
    fn parent_element(&self) -> Option<Self> {
        let node = self.node.parent_element().filter(|_| self.step())?;
        Some(Self { node, steps: self.steps })
    }

    fn prev_sibling_element(&self) -> Option<Self> {
        let node = self.node.prev_sibling_element().filter(|_| self.step())?;
        Some(Self { node, steps: self.steps })
    }

    fn has_local_name(&self, name: &str) -> bool {
        self.step() && self.node.tag_name().name() == name
    }

    fn attribute_matches(&self, local_name: &str, operator: AttributeOperator<'_>) -> bool {
        self.step() && self.node.attribute(local_name).is_some_and(|value| operator.matches(value))
    }

    fn pseudo_class_matches(&self, class: PseudoClass<'_>) -> bool {
        self.step() && class == PseudoClass::FirstChild && self.node.prev_sibling_element().is_none()
    }
}
