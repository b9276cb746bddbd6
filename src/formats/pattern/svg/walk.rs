//! The elements of a drawing as paths in mm: groups, copies, shapes, strokes and clip paths.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::sync::Arc;

use i_overlay::core::fill_rule::FillRule;
use nalgebra::{Matrix2, Vector2};
use roxmltree::{Node, NodeId};

use super::super::budget::{Budget, Cost};
use super::super::colour::nearest_index;
use super::super::content::{Content, FieldUse};
use super::super::error::{EntityName, PatternReadError};
use super::super::facts::Skipped;
use super::super::font::FontUses;
use super::super::reading::Strokes;
use super::area::{self, MAX_COORDINATE, Polygons, TOLERANCE, Unworkable};
use super::document::{Lines, attribute};
use super::length::number_of;
use super::outline;
use super::page::{fitted, view_box};
use super::place;
use super::stroke::{self, Pen};
use super::style::{Paint, Sheets, Style, is_svg};
use crate::geometry::pattern::{Affine, Color, Path, Segment, Shape, Source};
use crate::geometry::space::{Extents, FlatPoint};

/// Colour of all layers; every path has a colour of its own.
pub(super) const LAYER_COLOR: Color = Color::Aci(7);
/// Layer of everything outside Inkscape's layers.
pub(super) const NO_LAYER: &str = "0";
/// Deepest nesting of elements, copies included.
const MAX_DEPTH: usize = 96;
/// Largest number of dashes of one element.
const MAX_DASHES: f64 = 100_000.0;
/// Channels of a colour from this value on are white.
const WHITE: u8 = 0xf8;
/// A clip path that cuts off less than this, mm, has no effect.
const CLIP_TOLERANCE: f64 = 1e-3;
/// The ground of a page may leave this share of its sides uncovered: programs round.
const GROUND_TOLERANCE: f64 = 2e-3;

/// Elements that draw nothing themselves.
pub(super) const DEFINITIONS: &[&str] = &[
    "defs",
    "symbol",
    "clipPath",
    "mask",
    "marker",
    "linearGradient",
    "radialGradient",
    "pattern",
    "filter",
    "style",
    "script",
    "title",
    "desc",
    "metadata",
    "solidColor",
    "solidcolor",
    "animate",
    "animateColor",
    "animateMotion",
    "animateTransform",
    "set",
    "view",
    "cursor",
    "font",
    "font-face",
    "color-profile",
    "hatch",
    "meshgradient",
    "meshGradient",
    "stop",
];

/// What an element passes on to its children.
#[derive(Clone)]
pub(super) struct Context {
    /// From the units of the element to mm.
    pub(super) map: Affine,
    pub(super) style: Style,
    /// Width and height that percentages refer to, in the units of the element.
    pub(super) viewport: Vector2<f64>,
    pub(super) layer: Rc<str>,
    pub(super) opacity: f64,
    /// The areas that everything is cut to.
    pub(super) clips: Rc<[Rc<Polygons>]>,
    /// The name of the element that a `use` copies here.
    pub(super) block: Option<Arc<str>>,
}

impl Context {
    /// Cuts everything inside to an area, too.
    pub(super) fn clip_to(&mut self, area: Polygons) {
        self.clips = self.clips.iter().cloned().chain([Rc::new(area)]).collect();
    }

    /// The same with another style.
    pub(super) fn with_style(&self, style: &Style) -> Self {
        Self { style: style.clone(), ..self.clone() }
    }
}

/// What was noticed, for notices. A count comes with the first element.
#[derive(Default)]
pub(super) struct Remarks {
    pub(super) strokes: usize,
    /// The widest stroke, mm.
    pub(super) widest: Option<(f64, EntityName)>,
    /// Strokes that are marked as their centre lines because they are narrower than a beam.
    pub(super) hairlines: Option<(usize, EntityName)>,
    pub(super) undashed: Option<(usize, EntityName)>,
    pub(super) white: Option<(usize, EntityName)>,
    /// The white ground of the page, which is not marked.
    pub(super) ground: Option<Ground>,
    pub(super) servers: Option<(usize, EntityName)>,
    pub(super) transparent: Option<(usize, EntityName)>,
    pub(super) cut: Option<(usize, EntityName)>,
    pub(super) texts: Vec<FontUses>,
}

/// What a stroke follows.
struct Trace<'s> {
    shapes: &'s [Shape],
    /// From the units of the shapes to mm.
    to_mm: Affine,
    /// How many mm a unit of the shapes is, on average over all directions.
    scale: f64,
    /// How many units of the shapes the unit of its width and its dashes is.
    unit: f64,
}

/// The white ground of the page.
pub(super) struct Ground {
    pub(super) name: EntityName,
    /// Whether nothing is below it: no other ground, and nothing that was not read.
    pub(super) is_lowest: bool,
}

fn count(place: &mut Option<(usize, EntityName)>, name: impl FnOnce() -> EntityName) {
    match place {
        Some((count, _)) => *count += 1,
        None => *place = Some((1, name())),
    }
}

/// What is lost if an element is skipped.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Missing {
    Nothing,
    Hidden,
    Ink,
}

/// The drawing so far.
#[derive(Default)]
pub(super) struct Drawn {
    pub(super) layers: Vec<String>,
    pub(super) hidden_layers: BTreeSet<String>,
    pub(super) paths: Vec<Path>,
    pub(super) skipped: Vec<Skipped>,
    pub(super) entities: BTreeMap<String, BTreeMap<String, usize>>,
    pub(super) remarks: Remarks,
    /// Fields in texts.
    pub(super) fields: Vec<FieldUse>,
    regions: u32,
}

/// Draws a text.
type DrawText<'a, 'd> = fn(&mut Walk<'a, 'd>, Node<'a, 'd>, &Context) -> Result<(), PatternReadError>;

pub(super) struct Walk<'a, 'd> {
    pub(super) sheets: Sheets,
    pub(super) lines: Lines,
    pub(super) ids: BTreeMap<&'a str, Node<'a, 'd>>,
    pub(super) budget: &'a mut Budget,
    pub(super) strokes: Strokes,
    /// Width below which strokes are marked as their centre lines, mm.
    pub(super) hairline: f64,
    /// Size of a pixel on the page, mm.
    pub(super) pixel: f64,
    /// The values of fields in texts.
    pub(super) content: Option<&'a Content>,
    /// What is shown of the drawing, mm; a white rectangle over all of it, below everything else, is its ground. `None` if the
    /// ground is marked, too.
    pub(super) shown: Option<Extents>,
    pub(super) drawn: Drawn,
    draw_text: DrawText<'a, 'd>,
    open: Vec<NodeId>,
    depth: usize,
    listed: BTreeSet<(u32, String)>,
    layer_numbers: BTreeMap<Rc<str>, usize>,
    /// Whether elements that are not drawn contain something that could be.
    with_ink: BTreeMap<u32, bool>,
}

impl<'a, 'd> Walk<'a, 'd> {
    pub(super) fn new(
        root: Node<'a, 'd>,
        sheets: Sheets,
        lines: Lines,
        budget: &'a mut Budget,
        strokes: Strokes,
        pixel: f64,
        draw_text: DrawText<'a, 'd>,
    ) -> Self {
        let mut ids = BTreeMap::new();
        for node in root.descendants().filter(|node| node.is_element()) {
            if let Some(id) = attribute(node, "id") {
                ids.entry(id).or_insert(node);
            }
        }
        Self {
            sheets,
            lines,
            ids,
            budget,
            strokes,
            hairline: 0.0,
            pixel,
            content: None,
            shown: None,
            drawn: Drawn::default(),
            draw_text,
            open: Vec::new(),
            depth: 0,
            listed: BTreeSet::new(),
            layer_numbers: BTreeMap::new(),
            with_ink: BTreeMap::new(),
        }
    }

    /// Draws the whole document; `map` is that from the units of the root's content to mm.
    pub(super) fn root(
        &mut self,
        root: Node<'a, 'd>,
        map: Affine,
        viewport: Vector2<f64>,
    ) -> Result<(), PatternReadError> {
        let outer = Context {
            map,
            style: Style::default(),
            viewport,
            layer: NO_LAYER.into(),
            opacity: 1.0,
            clips: Rc::new([]),
            block: None,
        };
        let style = self.style(root, &outer)?;
        if !style.displayed {
            self.skip(root, NO_LAYER, "it is hidden (display: none)".into(), Missing::Hidden);
            return Ok(());
        }
        let Some(context) = self.enter(root, &outer, style, NO_LAYER.into())? else { return Ok(()) };
        match self.clipped(root, context)? {
            Some(context) => self.children(root, &context),
            None => Ok(()),
        }
    }

    pub(super) fn style(&self, node: Node<'a, 'd>, outer: &Context) -> Result<Style, PatternReadError> {
        let style = self.sheets.style(node, &outer.style, outer.viewport);
        style.map_err(|too_many| too_many.at(self.lines.name(node, &outer.layer)))
    }

    fn children(&mut self, node: Node<'a, 'd>, context: &Context) -> Result<(), PatternReadError> {
        for child in node.children().filter(|child| is_svg(*child)) {
            self.element(child, context)?;
        }
        Ok(())
    }

    fn element(&mut self, node: Node<'a, 'd>, outer: &Context) -> Result<(), PatternReadError> {
        if DEFINITIONS.contains(&node.tag_name().name()) {
            return Ok(());
        }
        self.spend(Cost::Unfolded, 1, node, outer)?;
        self.budget.begin_entity();
        if self.depth == MAX_DEPTH {
            return Err(PatternReadError::TooMany {
                what: "levels of nested elements",
                limit: MAX_DEPTH,
                entity: Some(self.lines.name(node, &outer.layer)),
            });
        }
        self.depth += 1;
        let done = self.inside(node, outer);
        self.depth -= 1;
        done
    }

    fn inside(&mut self, node: Node<'a, 'd>, outer: &Context) -> Result<(), PatternReadError> {
        let style = self.style(node, outer)?;
        let layer = match inkscape(node, "groupmode") {
            Some("layer") => {
                let name = inkscape(node, "label").or(attribute(node, "id")).unwrap_or("layer").trim();
                Rc::from(if name.is_empty() { "layer" } else { name })
            }
            _ => outer.layer.clone(),
        };
        if !style.displayed {
            if layer != outer.layer {
                self.drawn.hidden_layers.insert(layer.to_string());
            }
            if self.has_ink(node) {
                self.skip(node, &layer, "it is hidden (display: none)".into(), Missing::Hidden);
            }
            return Ok(());
        }
        let Some(context) = self.enter(node, outer, style, layer)? else { return Ok(()) };
        let tag = node.tag_name().name();
        if tag == "svg" {
            return match self.box_of(node, &context, None) {
                Ok(sides) => self.nested(node, &context, sides),
                Err(why) => self.unread(node, &context, why),
            };
        }
        // The position of a copy is part of its transform, inside which its clip path is (SVG 2, section 5.6).
        let context = match tag {
            "use" => match self.shifted(node, context.clone()) {
                Ok(context) => context,
                Err(why) => return self.unread(node, &context, why),
            },
            _ => context,
        };
        let Some(context) = self.clipped(node, context)? else { return Ok(()) };
        match tag {
            "g" | "a" => self.children(node, &context),
            "switch" => match node.children().find(|child| is_svg(*child) && is_eligible(*child)) {
                Some(child) => self.element(child, &context),
                None => Ok(()),
            },
            "use" => self.copy(node, &context),
            "text" => (self.draw_text)(self, node, &context),
            "image" => {
                self.lost(node, &context, "it is a picture: trace it, or mark it in a job of its own as PNG")
            }
            "foreignObject" | "iframe" | "video" | "audio" | "canvas" => self.lost(
                node,
                &context,
                "it is not drawn with SVG: convert it to paths in the drawing program",
            ),
            "flowRoot" | "textPath" | "tref" | "altGlyph" => self.lost(
                node,
                &context,
                "text of this kind is not read: convert it to paths (Path > Object to Path)",
            ),
            "path" | "rect" | "circle" | "ellipse" | "line" | "polyline" | "polygon" => {
                self.count(node, &context);
                let (shapes, read) = self.shapes(node, &context);
                if let Err(why) = read {
                    self.skip(node, &context.layer, why.into(), Missing::Ink);
                    return Ok(());
                }
                if context.style.has_markers {
                    let why = "its markers (arrowheads) are not read: convert them (Path > Stroke to Path)";
                    self.skip(node, &context.layer, why.into(), Missing::Ink);
                }
                self.draw(
                    node,
                    shapes,
                    &context.style,
                    &context,
                    matches!(tag, "rect" | "circle" | "ellipse"),
                )
            }
            _ => Ok(()),
        }
    }

    /// What an element with a style passes on to its children, not cut by its clip path; nothing if it is not drawn.
    fn enter(
        &mut self,
        node: Node<'a, 'd>,
        outer: &Context,
        style: Style,
        layer: Rc<str>,
    ) -> Result<Option<Context>, PatternReadError> {
        let opacity = outer.opacity * style.opacity;
        if opacity == 0.0 {
            self.skip(node, &layer, "it is fully transparent".into(), Missing::Nothing);
            return Ok(None);
        }
        if let Some(why) = style.unread_own() {
            if self.has_ink(node) {
                self.skip(node, &layer, why.to_owned().into(), Missing::Ink);
            }
            return Ok(None);
        }
        let map = match place::own(&style, outer.viewport) {
            Ok(own) => own.map_or(outer.map, |own| outer.map.after(&own)),
            Err(why) => {
                if self.has_ink(node) {
                    self.skip(node, &layer, why.into(), Missing::Ink);
                }
                return Ok(None);
            }
        };
        if map.linear.determinant() == 0.0 {
            self.skip(node, &layer, "it is scaled to nothing".into(), Missing::Nothing);
            return Ok(None);
        }
        let context = Context {
            map,
            opacity,
            layer,
            viewport: outer.viewport,
            clips: outer.clips.clone(),
            block: outer.block.clone(),
            style,
        };
        if let Some(why) = self.hides(&context.style) {
            if self.has_ink(node) {
                self.skip(node, &context.layer, why.into(), Missing::Ink);
            }
            return Ok(None);
        }
        Ok(Some(context))
    }

    /// Cuts an element by its clip path, which is in the units of its content; nothing if it is not drawn.
    fn clipped(
        &mut self,
        node: Node<'a, 'd>,
        mut context: Context,
    ) -> Result<Option<Context>, PatternReadError> {
        if let Some(id) = context.style.clip.clone()
            && let Some(clip) =
                self.ids.get(&*id).copied().filter(|node| node.tag_name().name() == "clipPath")
        {
            match self.clip(clip, &context)? {
                Ok(clip) if clip.is_empty() => {
                    self.skip(node, &context.layer, "its clip path is empty".into(), Missing::Nothing);
                    return Ok(None);
                }
                Ok(clip) => context.clip_to(clip),
                Err(why) => {
                    self.skip(node, &context.layer, why, Missing::Ink);
                    return Ok(None);
                }
            }
        }
        Ok(Some(context))
    }

    /// Whether an element contains something that can be drawn.
    fn has_ink(&mut self, node: Node<'a, 'd>) -> bool {
        *self.with_ink.entry(node.id().get()).or_insert_with(|| has_ink(node))
    }

    /// The reason why an element with this style cannot be read.
    fn hides(&self, style: &Style) -> Option<&'static str> {
        let has_mask = style.mask.as_ref().is_some_and(|id| self.ids.contains_key(&**id));
        if has_mask {
            Some("it has a mask: cut it to its visible part in the drawing program")
        } else if style.filter {
            Some("it has a filter effect: remove the filter, or convert the result to paths")
        } else if style.has_css_clip {
            Some("it is clipped by a shape in its style: cut it in the drawing program")
        } else {
            None
        }
    }

    fn lost(
        &mut self,
        node: Node<'a, 'd>,
        context: &Context,
        why: &'static str,
    ) -> Result<(), PatternReadError> {
        self.count(node, context);
        let missing = if context.style.visible { Missing::Ink } else { Missing::Hidden };
        self.skip(node, &context.layer, why.into(), missing);
        Ok(())
    }

    /// Lists an element that cannot be read.
    fn unread(&mut self, node: Node<'a, 'd>, context: &Context, why: String) -> Result<(), PatternReadError> {
        self.skip(node, &context.layer, why.into(), Missing::Ink);
        Ok(())
    }

    /// What an element passes on at its position `x`, `y`, or why that cannot be read.
    fn shifted(&self, node: Node<'a, 'd>, context: Context) -> Result<Context, String> {
        let side = |name, whole| Ok::<_, String>(self.length(node, name, whole, &context)?.unwrap_or(0.0));
        let offset = Vector2::new(side("x", context.viewport.x)?, side("y", context.viewport.y)?);
        let shift = Affine { linear: Matrix2::identity(), offset };
        Ok(Context { map: context.map.after(&shift), ..context })
    }

    /// A copy of another element, at its position.
    fn copy(&mut self, node: Node<'a, 'd>, context: &Context) -> Result<(), PatternReadError> {
        let Some(id) = link(node).strip_prefix('#') else {
            return self.lost(
                node,
                context,
                "it refers to another file: import that file in the drawing program",
            );
        };
        let Some(target) = self.ids.get(id).copied() else {
            return self.lost(node, context, "the element that it copies is not in the file");
        };
        if self.open.contains(&target.id()) || node.ancestors().any(|outer| outer == target) {
            self.skip(
                node,
                &context.layer,
                "it is a copy of an element that contains it".into(),
                Missing::Hidden,
            );
            return Ok(());
        }
        let mut context = Context { block: Some(id.into()), ..context.clone() };
        context.style.context_paints = [context.style.fill, context.style.stroke];
        self.open.push(target.id());
        let done = match target.tag_name().name() {
            "symbol" | "svg" => self.instance(node, target, &context),
            _ => self.element(target, &context),
        };
        self.open.pop();
        done
    }

    /// A copy of a symbol or of a nested drawing.
    fn instance(
        &mut self,
        node: Node<'a, 'd>,
        target: Node<'a, 'd>,
        context: &Context,
    ) -> Result<(), PatternReadError> {
        if self.depth >= MAX_DEPTH {
            return self.element(target, context);
        }
        let style = self.style(target, context)?;
        if !style.displayed {
            return Ok(());
        }
        let Some(inner) = self.enter(target, context, style, context.layer.clone())? else {
            return Ok(());
        };
        match self.box_of(target, &inner, Some((node, context))) {
            Ok(sides) => self.nested(target, &inner, sides),
            Err(why) => self.unread(node, context, why),
        }
    }

    /// Position and size of a nested drawing, in units of the element; the size may come from the `use`.
    fn box_of(
        &self,
        node: Node<'a, 'd>,
        context: &Context,
        by: Option<(Node<'a, 'd>, &Context)>,
    ) -> Result<[f64; 4], String> {
        let whole = context.viewport;
        let side = |name, whole| {
            let of_use = by.map(|(by, context)| self.length(by, name, whole, context)).transpose()?.flatten();
            let own = || self.length(node, name, whole, context);
            Ok::<_, String>(of_use.map_or_else(own, |side| Ok(Some(side)))?.unwrap_or(whole))
        };
        let at = |name, whole| Ok::<_, String>(self.length(node, name, whole, context)?.unwrap_or(0.0));
        let sides = [at("x", whole.x)?, at("y", whole.y)?, side("width", whole.x)?, side("height", whole.y)?];
        match attribute(node, "viewBox").filter(|text| !text.trim().is_empty() && view_box(node).is_none()) {
            Some(text) => Err(unread_length("viewBox", text)),
            None => Ok(sides),
        }
    }

    /// Draws a nested drawing of this position and size, with its `viewBox`. What is outside its edges is cut off, as
    /// programs show it, unless `overflow` allows it.
    fn nested(
        &mut self,
        node: Node<'a, 'd>,
        context: &Context,
        [x, y, width, height]: [f64; 4],
    ) -> Result<(), PatternReadError> {
        let size = Vector2::new(width, height);
        let shift = Affine { linear: Matrix2::identity(), offset: Vector2::new(x, y) };
        let map = context.map.after(&shift);
        let mut inner = match view_box(node) {
            Some(view) => Context {
                map: map.after(&fitted(node, view, size)),
                viewport: Vector2::new(view.w, view.h),
                ..context.clone()
            },
            None => Context { map, viewport: size, ..context.clone() },
        };
        if !context.style.overflows {
            let corners = [[0.0, 0.0], [size.x, 0.0], [size.x, size.y], [0.0, size.y]];
            let corners = corners.map(|[x, y]| map.point(FlatPoint::new(x, y)));
            self.check_reach(&corners.map(Shape::Dot), node, context)?;
            let mut edges: Vec<[f64; 2]> = corners.map(|corner| [corner.x, corner.y]).to_vec();
            if map.linear.determinant() < 0.0 {
                edges.reverse();
            }
            inner.clip_to(vec![edges]);
        }
        match self.clipped(node, inner)? {
            Some(inner) => self.children(node, &inner),
            None => Ok(()),
        }
    }

    /// A size or position in user units, if the element has it, or why it cannot be read.
    pub(super) fn length(
        &self,
        node: Node<'a, 'd>,
        name: &str,
        whole: f64,
        context: &Context,
    ) -> Result<Option<f64>, String> {
        if let Some(why) = context.style.unread_geometry(name) {
            return Err(why.to_owned());
        }
        let style = &context.style;
        let (text, is_css) = match (style.geometry(name), attribute(node, name)) {
            (Some(text), _) => (text, true),
            (None, Some(text)) => (text, false),
            (None, None) => return Ok(None),
        };
        let text = text.trim();
        if text.eq_ignore_ascii_case("auto") {
            return Ok(None);
        }
        let length = style.length(text, whole);
        // Without a unit, CSS knows only zero.
        let is_valid = !is_css || length == Some(0.0) || number_of(text).is_none();
        length.filter(|_| is_valid).map(Some).ok_or_else(|| unread_length(name, text))
    }

    /// The curves of a shape, and whether its data could be read.
    pub(super) fn shapes(&self, node: Node<'a, 'd>, context: &Context) -> (Vec<Shape>, Result<(), String>) {
        if node.tag_name().name() == "path" {
            let style = &context.style;
            if let Some(why) = style.unread_geometry("d") {
                return (Vec::new(), Err(why.to_owned()));
            }
            if let Some(data) = style.geometry("d") {
                return (Vec::new(), Err(unread_length("d", data)));
            }
            let (shapes, read) = outline::path(attribute(node, "d").unwrap_or_default());
            let read = read.map_err(|error| {
                format!("its path data cannot be read ({error}): export the drawing again, or delete it")
            });
            return (shapes, read);
        }
        match self.basic_shape(node, context) {
            Ok(shape) => (shape.into_iter().collect(), Ok(())),
            Err(why) => (Vec::new(), Err(why)),
        }
    }

    fn basic_shape(&self, node: Node<'a, 'd>, context: &Context) -> Result<Option<Shape>, String> {
        let (w, h) = (context.viewport.x, context.viewport.y);
        let diagonal = context.viewport.norm() / 2.0_f64.sqrt();
        let maybe = |name, whole| self.length(node, name, whole, context);
        let of = |name, whole| Ok::<_, String>(maybe(name, whole)?.unwrap_or(0.0));
        Ok(match node.tag_name().name() {
            "rect" => {
                let radius =
                    |name, whole| Ok::<_, String>(maybe(name, whole)?.filter(|radius| *radius >= 0.0));
                let (rx, ry) = (radius("rx", w)?, radius("ry", h)?);
                let radii = [rx.or(ry).unwrap_or(0.0), ry.or(rx).unwrap_or(0.0)];
                let size = Vector2::new(of("width", w)?, of("height", h)?);
                outline::rectangle(FlatPoint::new(of("x", w)?, of("y", h)?), size, radii)
            }
            "circle" => {
                let radius = of("r", diagonal)?;
                outline::ellipse(FlatPoint::new(of("cx", w)?, of("cy", h)?), radius, radius)
            }
            "ellipse" => {
                let (rx, ry) = (maybe("rx", w)?, maybe("ry", h)?);
                let [rx, ry] = [rx.or(ry).unwrap_or(0.0), ry.or(rx).unwrap_or(0.0)];
                outline::ellipse(FlatPoint::new(of("cx", w)?, of("cy", h)?), rx, ry)
            }
            "line" => Some(outline::line(
                FlatPoint::new(of("x1", w)?, of("y1", h)?),
                FlatPoint::new(of("x2", w)?, of("y2", h)?),
            )),
            tag => {
                let points = attribute(node, "points").unwrap_or_default();
                outline::polyline(points, tag == "polygon").map_err(|error| {
                    format!("its points cannot be read ({error}): export the drawing again, or delete it")
                })?
            }
        })
    }

    /// Draws shapes in the units of the context with a style. `plain` shapes do not cross themselves.
    pub(super) fn draw(
        &mut self,
        node: Node<'a, 'd>,
        shapes: Vec<Shape>,
        style: &Style,
        context: &Context,
        plain: bool,
    ) -> Result<(), PatternReadError> {
        if shapes.is_empty() {
            self.skip(node, &context.layer, "it has no size".into(), Missing::Nothing);
            return Ok(());
        }
        if let Some(why) = style.unread_visibility() {
            return self.unread(node, context, why.to_owned());
        }
        if !style.visible {
            self.skip(node, &context.layer, "it is hidden (visibility)".into(), Missing::Hidden);
            return Ok(());
        }
        let map = context.map;
        let ink = |paint: Paint, alpha: f64| match paint {
            Paint::Color { alpha: own, .. } if own * alpha == 0.0 => Paint::None,
            paint => paint,
        };
        let mut fill = ink(style.fill, style.fill_alpha);
        let mut stroke = ink(style.stroke, style.stroke_alpha);
        if let Some(why) = style.unread_paint(fill != Paint::None, stroke != Paint::None) {
            return self.unread(node, context, why.to_owned());
        }
        if !(style.stroke_width > 0.0) && stroke != Paint::None {
            stroke = Paint::None;
            if fill == Paint::None {
                self.skip(node, &context.layer, "its stroke has no width".into(), Missing::Hidden);
                return Ok(());
            }
        }
        if fill == Paint::None && stroke == Paint::None {
            self.skip(node, &context.layer, "it has neither fill nor stroke".into(), Missing::Nothing);
            return Ok(());
        }
        let is_dashed = stroke != Paint::None && !style.dashes.is_empty();
        let stated = match attribute(node, "pathLength").filter(|_| is_dashed) {
            Some(text) => match number_of(text.trim()).filter(|length| *length > 0.0) {
                Some(length) => Some(length),
                None => return self.unread(node, context, unread_length("pathLength", text)),
            },
            None => None,
        };
        let pieces: usize = shapes.iter().map(|shape| shape.segments().len().max(1)).sum();
        self.spend(Cost::Drawn, pieces, node, context)?;
        let in_mm: Vec<Shape> = shapes.iter().map(|shape| transformed(shape, &map)).collect();
        self.check_reach(&in_mm, node, context)?;
        if is_white(fill) && self.is_ground(&in_mm, context) {
            let is_lowest = self.drawn.remarks.ground.is_none()
                && !self.drawn.skipped.iter().any(|skipped| skipped.is_ink);
            self.drawn.remarks.ground =
                Some(Ground { name: self.lines.name(node, &context.layer), is_lowest });
            fill = Paint::None;
            if stroke == Paint::None {
                return Ok(());
            }
        }
        self.note_paints(node, style, context, fill, stroke);

        // The filled area.
        let mut filled: Vec<Shape> = Vec::new();
        if fill != Paint::None {
            filled = contours(&in_mm);
            filled.retain(has_area);
            if style.fill_rule == FillRule::NonZero && !plain && !filled.is_empty() {
                filled = self.nonzero(filled, node, context)?;
            }
        }
        let fill_color = color(fill);
        if stroke == Paint::None {
            if filled.is_empty() {
                self.skip(node, &context.layer, "it has no area and no stroke".into(), Missing::Nothing);
                return Ok(());
            }
            return self.region(node, filled, fill_color, context);
        }

        // A stroke whose width is in units of the page is drawn there, any other one in the units of its element.
        let here = Affine { linear: Matrix2::identity(), offset: Vector2::zeros() };
        let trace = match style.fixed_width {
            true => Trace { shapes: &in_mm, to_mm: here, scale: 1.0, unit: self.pixel },
            false => {
                let scale = map.linear.determinant().abs().sqrt();
                Trace { shapes: &shapes, to_mm: map, scale, unit: 1.0 }
            }
        };
        let own_width = style.stroke_width * trace.unit;
        let width = own_width * trace.scale;
        self.note_width(node, context, width);
        let dashes = self.dashes(node, &trace, style, stated, context);
        let color = color(stroke);
        let is_hairline = width < self.hairline;
        if self.strokes == Strokes::Band && is_hairline {
            let name = self.lines.name(node, &context.layer);
            count(&mut self.drawn.remarks.hairlines, || name);
        }
        if self.strokes == Strokes::Band && !is_hairline {
            let pen =
                Pen { width: own_width, cap: style.cap, join: style.join, miter_limit: style.miter_limit };
            let tolerance = TOLERANCE / trace.scale;
            let pieces = dashes
                .as_ref()
                .map(|(pattern, offset)| area::dashes(trace.shapes, pattern, *offset, 0.0, tolerance / 10.0));
            let lines = pieces.as_deref().unwrap_or(trace.shapes);
            let band = stroke::band(lines, &pen, &trace.to_mm, tolerance, self.budget);
            let mut band = self.within(band, node, context)?;
            if !filled.is_empty() && color == fill_color {
                let both = area::flattened(&filled, self.budget)
                    .and_then(|flat| area::united(&flat, FillRule::EvenOdd, self.budget))
                    .and_then(|fill| {
                        band.extend(fill);
                        area::united(&band, FillRule::NonZero, self.budget)
                    });
                band = self.within(both, node, context)?;
                filled.clear();
            }
            if !filled.is_empty() {
                self.region(node, filled, fill_color, context)?;
            }
            let band = area::shapes(band, true);
            if band.is_empty() {
                return Ok(());
            }
            let pieces: usize = band.iter().map(|shape| shape.segments().len()).sum();
            self.spend(Cost::Drawn, pieces, node, context)?;
            return self.region(node, band, color, context);
        }

        let is_outlined = !filled.is_empty() && color == fill_color && dashes.is_none();
        if !filled.is_empty() {
            self.region(node, filled, fill_color, context)?;
        }
        let (lines, is_stroke) = match dashes {
            Some((pattern, offset)) => {
                let least = own_width * area::LEAST_DASH * 1.001;
                let tolerance = TOLERANCE / trace.scale / 10.0;
                let pieces = area::dashes(trace.shapes, &pattern, offset, least, tolerance);
                (pieces.iter().map(|shape| transformed(shape, &trace.to_mm)).collect(), true)
            }
            // The outline of an area in its own colour is marked with the area.
            None if is_outlined => {
                (in_mm.into_iter().filter(|shape| !has_area(&closed(shape))).collect(), false)
            }
            None => (in_mm, false),
        };
        self.spend(
            Cost::Drawn,
            lines.iter().map(|shape: &Shape| shape.segments().len()).sum(),
            node,
            context,
        )?;
        for shape in lines {
            // A stroke without length shows only with ends that reach beyond it.
            if matches!(shape, Shape::Dot(_)) && style.cap == kurbo::Cap::Butt {
                continue;
            }
            self.line(node, shape, color, is_stroke, context)?;
        }
        Ok(())
    }

    /// Whether these shapes, in mm, are the ground of the page: a rectangle over all that is shown, before anything else is drawn.
    /// What a clip path cuts to another shape is a drawing.
    fn is_ground(&self, shapes: &[Shape], context: &Context) -> bool {
        let (Some(shown), [shape]) = (&self.shown, shapes) else { return false };
        let contour = closed(shape);
        let is_straight = contour.segments().iter().all(|segment| matches!(segment, Segment::Line { .. }));
        let corners = contour.segments().iter().map(|segment| [segment.start().x, segment.start().y]);
        let covers = |area: &Polygons| area::is_rectangle_over(area, shown, CLIP_TOLERANCE, GROUND_TOLERANCE);
        self.drawn.paths.is_empty()
            && is_straight
            && covers(&vec![corners.collect()])
            && context.clips.iter().all(|clip| covers(clip))
    }

    fn note_paints(
        &mut self,
        node: Node<'a, 'd>,
        style: &Style,
        context: &Context,
        fill: Paint,
        stroke: Paint,
    ) {
        let name = || self.lines.name(node, &context.layer);
        let remarks = &mut self.drawn.remarks;
        let paints = [(fill, style.fill_alpha), (stroke, style.stroke_alpha)];
        if paints.iter().any(|(paint, _)| is_white(*paint)) {
            count(&mut remarks.white, name);
        }
        if fill == Paint::Server || stroke == Paint::Server {
            count(&mut remarks.servers, name);
        }
        let alpha = |paint| if let Paint::Color { alpha, .. } = paint { alpha } else { 1.0 };
        let is_thin = |(paint, own): &(Paint, f64)| {
            *paint != Paint::None && alpha(*paint) * own * context.opacity < 1.0
        };
        if paints.iter().any(is_thin) {
            count(&mut remarks.transparent, name);
        }
    }

    fn note_width(&mut self, node: Node<'a, 'd>, context: &Context, width: f64) {
        let name = self.lines.name(node, &context.layer);
        let remarks = &mut self.drawn.remarks;
        remarks.strokes += 1;
        if remarks.widest.as_ref().is_none_or(|(widest, _)| width > *widest) {
            remarks.widest = Some((width, name));
        }
    }

    /// The dashes of a stroke in its units and where they begin; `None` for a whole line. `stated` is the `pathLength`.
    fn dashes(
        &mut self,
        node: Node<'a, 'd>,
        trace: &Trace<'_>,
        style: &Style,
        stated: Option<f64>,
        context: &Context,
    ) -> Option<(Vec<f64>, f64)> {
        if style.dashes.is_empty() {
            return None;
        }
        let length = area::path_length(trace.shapes, TOLERANCE / trace.scale);
        // Dashes are shares of the length that the path states.
        let factor = stated.filter(|_| length > 0.0).map_or(trace.unit, |stated| length / stated);
        let mut pattern: Vec<f64> = style.dashes.iter().map(|dash| dash * factor).collect();
        if pattern.len() % 2 == 1 {
            pattern.extend_from_within(..);
        }
        if style.cap != kurbo::Cap::Butt {
            // A dash without length shows only its ends; it needs a direction.
            let least = style.stroke_width * trace.unit * area::LEAST_DASH;
            for at in (0..pattern.len()).step_by(2).filter(|at| pattern[*at] < least).collect::<Vec<_>>() {
                pattern[at] = least;
                pattern[at + 1] = (pattern[at + 1] - least).max(0.0);
            }
        }
        let period: f64 = pattern.iter().sum();
        let number = length / period * pattern.len() as f64;
        if !(number < MAX_DASHES) || pattern.len() > 1000 || self.budget.work(number as usize * 64).is_err() {
            let name = self.lines.name(node, &context.layer);
            count(&mut self.drawn.remarks.undashed, || name);
            return None;
        }
        Some((pattern, (style.dash_offset * factor).rem_euclid(period)))
    }

    /// The contours whose even-odd area is the nonzero area of the given ones: the same if nothing overlaps.
    fn nonzero(
        &mut self,
        exact: Vec<Shape>,
        node: Node<'a, 'd>,
        context: &Context,
    ) -> Result<Vec<Shape>, PatternReadError> {
        let both = area::flattened(&exact, self.budget).and_then(|flat| {
            let even_odd = area::united(&flat, FillRule::EvenOdd, self.budget)?;
            Ok((even_odd, area::united(&flat, FillRule::NonZero, self.budget)?))
        });
        let (even_odd, nonzero) = self.within(both, node, context)?;
        Ok(if area::same_area(&even_odd, &nonzero) { exact } else { area::shapes(nonzero, true) })
    }

    /// Adds a filled region, cut by the clip paths.
    fn region(
        &mut self,
        node: Node<'a, 'd>,
        mut contours: Vec<Shape>,
        color: Color,
        context: &Context,
    ) -> Result<(), PatternReadError> {
        for clip in context.clips.iter() {
            if is_inside(&contours, clip) {
                continue;
            }
            let cut = area::flattened(&contours, self.budget)
                .and_then(|flat| area::united(&flat, FillRule::EvenOdd, self.budget))
                .and_then(|whole| {
                    let cut = area::intersection(&whole, clip, self.budget)?;
                    let slack = CLIP_TOLERANCE * area::length(&whole, true);
                    Ok((area::area(&whole) - area::area(&cut) > slack).then_some(cut))
                });
            if let Some(cut) = self.within(cut, node, context)? {
                self.note_cut(node, context);
                contours = area::shapes(cut, true);
            }
        }
        if contours.is_empty() {
            self.skip(node, &context.layer, "it is outside its clip path".into(), Missing::Nothing);
            return Ok(());
        }
        self.drawn.regions += 1;
        let region = self.drawn.regions;
        for shape in contours {
            self.push(node, shape, Some(region), color, false, context);
        }
        Ok(())
    }

    /// Adds a line, cut by the clip paths.
    fn line(
        &mut self,
        node: Node<'a, 'd>,
        shape: Shape,
        color: Color,
        is_stroke: bool,
        context: &Context,
    ) -> Result<(), PatternReadError> {
        let mut lines = vec![shape];
        for clip in context.clips.iter() {
            if is_inside(&lines, clip) {
                continue;
            }
            let mut kept = Vec::new();
            for shape in lines {
                if let Shape::Dot(_) = shape {
                    // A dot outside the bounds of the clip path is not drawn.
                    if bounds(&area::extents(clip), &shape) {
                        kept.push(shape);
                    }
                    continue;
                }
                let cut = area::flattened(std::slice::from_ref(&shape), self.budget).and_then(|mut flat| {
                    if let (true, Some(line)) = (shape.is_closed(), flat.first_mut()) {
                        line.extend(line.first().copied());
                    }
                    let cut = area::clipped(&flat, clip, self.budget)?;
                    let lost = area::length(&flat, false) - area::length(&cut, false);
                    Ok((lost > CLIP_TOLERANCE).then_some(cut))
                });
                match self.within(cut, node, context)? {
                    Some(cut) => {
                        self.note_cut(node, context);
                        kept.extend(area::shapes(cut, false));
                    }
                    None => kept.push(shape),
                }
            }
            lines = kept;
        }
        for shape in lines {
            self.push(node, shape, None, color, is_stroke, context);
        }
        Ok(())
    }

    fn note_cut(&mut self, node: Node<'a, 'd>, context: &Context) {
        let name = self.lines.name(node, &context.layer);
        count(&mut self.drawn.remarks.cut, || name);
    }

    fn push(
        &mut self,
        node: Node<'a, 'd>,
        shape: Shape,
        region: Option<u32>,
        color: Color,
        is_stroke: bool,
        context: &Context,
    ) {
        let layers = &mut self.drawn.layers;
        let layer = *self.layer_numbers.entry(context.layer.clone()).or_insert_with(|| {
            layers.push(context.layer.to_string());
            layers.len() - 1
        });
        let source = Source {
            entity: node.tag_name().name().into(),
            handle: Some(self.lines.handle(node)),
            is_stroke,
            block: context.block.clone(),
        };
        self.drawn.paths.push(Path { layer, color, shape, region, source });
    }

    pub(super) fn count(&mut self, node: Node<'a, 'd>, context: &Context) {
        let of_kind = self.drawn.entities.entry(node.tag_name().name().into()).or_default();
        *of_kind.entry(context.layer.to_string()).or_default() += 1;
    }

    pub(super) fn skip(&mut self, node: Node<'a, 'd>, layer: &str, why: Cow<'static, str>, missing: Missing) {
        // Copies of an element are listed once.
        if self.listed.insert((node.id().get(), why.to_string())) {
            self.drawn.skipped.push(Skipped {
                entity: node.tag_name().name().into(),
                handle: Some(self.lines.handle(node)),
                layer: layer.to_owned(),
                why,
                is_loss: missing != Missing::Nothing,
                is_ink: missing == Missing::Ink,
            });
        }
    }

    pub(super) fn spend(
        &mut self,
        cost: Cost,
        count: usize,
        node: Node<'a, 'd>,
        context: &Context,
    ) -> Result<(), PatternReadError> {
        let spent = self.budget.spend(cost, count);
        spent.map_err(|_| cost.too_many(self.lines.name(node, &context.layer)))
    }

    /// The result of work on areas, or the error if it exceeds the budget.
    pub(super) fn within<T>(
        &self,
        done: Result<T, Unworkable>,
        node: Node<'a, 'd>,
        context: &Context,
    ) -> Result<T, PatternReadError> {
        let entity = || self.lines.name(node, &context.layer);
        done.map_err(|why| match why {
            Unworkable::Exceeded => PatternReadError::TooMany {
                what: "corners and crossings in an outline",
                limit: 1_000_000,
                entity: Some(entity()),
            },
            Unworkable::OutOfRange(reach) => {
                PatternReadError::OutOfRange { entity: entity(), reach, limit: MAX_COORDINATE }
            }
        })
    }

    pub(super) fn check_reach(
        &self,
        shapes: &[Shape],
        node: Node<'a, 'd>,
        context: &Context,
    ) -> Result<(), PatternReadError> {
        let reach = shapes.iter().map(reach).fold(0.0, f64::max);
        if reach <= MAX_COORDINATE {
            return Ok(());
        }
        let entity = self.lines.name(node, &context.layer);
        Err(PatternReadError::OutOfRange { entity, reach, limit: MAX_COORDINATE })
    }
}

/// What an element refers to: its `href`, or else the `xlink:href` of SVG 1.1 (SVG 2, section 16.1.6); empty without both.
pub(super) fn link<'a>(node: Node<'a, '_>) -> &'a str {
    let links = node.attributes().filter(|attribute| attribute.name() == "href");
    links.min_by_key(|link| link.namespace().is_some()).map_or("", |link| link.value().trim())
}

/// An attribute of Inkscape.
fn inkscape<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    node.attributes()
        .find(|attribute| {
            attribute.name() == name && attribute.namespace().is_some_and(|space| space.contains("inkscape"))
        })
        .map(|attribute| attribute.value())
}

/// Whether an element contains something that can be drawn.
fn has_ink(node: Node<'_, '_>) -> bool {
    const DRAWN: &[&str] = &[
        "path",
        "rect",
        "circle",
        "ellipse",
        "line",
        "polyline",
        "polygon",
        "text",
        "use",
        "image",
        "flowRoot",
        "foreignObject",
    ];
    node.descendants().any(|inside| is_svg(inside) && DRAWN.contains(&inside.tag_name().name()))
}

/// Whether a child of a `switch` may be drawn: it needs no extension, and its language is English or none.
fn is_eligible(node: Node<'_, '_>) -> bool {
    let language = |languages: &str| {
        languages.split(',').any(|language| language.trim().to_ascii_lowercase().starts_with("en"))
    };
    attribute(node, "requiredExtensions").is_none()
        && attribute(node, "systemLanguage").is_none_or(language)
        && !DEFINITIONS.contains(&node.tag_name().name())
}

/// Why an attribute or property with this text cannot be read.
pub(super) fn unread_length(name: &str, text: &str) -> String {
    let text: String = text.chars().take(60).collect();
    format!(
        "its `{name}` of `{text}` cannot be read: write a number with a decimal point and a unit of CSS or none, or export the \
         drawing again"
    )
}

fn color(paint: Paint) -> Color {
    let rgb = if let Paint::Color { rgb, .. } = paint { rgb } else { [0; 3] };
    // Index 7 is the colour of the pen: black on paper.
    let aci = if rgb == [0; 3] { 7 } else { nearest_index(rgb) };
    Color::Rgb { aci, rgb }
}

fn is_white(paint: Paint) -> bool {
    matches!(paint, Paint::Color { rgb, .. } if rgb.iter().all(|channel| *channel >= WHITE))
}

pub(super) fn transformed(shape: &Shape, map: &Affine) -> Shape {
    let all = |segments: &[Segment]| segments.iter().map(|segment| segment.transformed(map)).collect();
    match shape {
        Shape::Dot(point) => Shape::Dot(map.point(*point)),
        Shape::Open(segments) => Shape::Open(all(segments)),
        Shape::Closed(segments) => Shape::Closed(all(segments)),
    }
}

/// The shape, closed with a straight line as fills are.
fn closed(shape: &Shape) -> Shape {
    let mut segments = shape.segments().to_vec();
    if let (Some(first), Some(last)) = (segments.first(), segments.last()) {
        let (from, to) = (last.end(), first.start());
        if !shape.is_closed() && from != to {
            segments.push(Segment::Line { from, to });
        }
    }
    Shape::Closed(segments)
}

pub(super) fn contours(shapes: &[Shape]) -> Vec<Shape> {
    shapes.iter().filter(|shape| !shape.segments().is_empty()).map(closed).collect()
}

/// Whether a contour encloses anything: its points are not all on one straight line.
fn has_area(contour: &Shape) -> bool {
    let points = contour.flattened(TOLERANCE);
    let Some(first) = points.first().copied() else { return false };
    let farthest = points.iter().copied().max_by(|a, b| first.distance(*a).total_cmp(&first.distance(*b)));
    let Some(along) = farthest.and_then(|point| (point - first).try_normalize(0.0)) else { return false };
    points.iter().any(|point| along.perp(&(*point - first)).abs() > crate::geometry::pattern::SAME_POINT)
}

/// The largest coordinate of the points that define a shape, mm; not finite if one of them is not.
fn reach(shape: &Shape) -> f64 {
    let of = |point: FlatPoint| match point.is_finite() {
        true => point.x.abs().max(point.y.abs()),
        false => f64::INFINITY,
    };
    let points = |segment: &Segment| match segment {
        Segment::Bezier { points, .. } => points.iter().map(|point| of(*point)).fold(0.0, f64::max),
        Segment::Arc { u, v, .. } => {
            let size = if u.iter().chain(v).all(|side| side.is_finite()) { 0.0 } else { f64::INFINITY };
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| of(segment.point(t))).into_iter().fold(size, f64::max)
        }
        Segment::Line { .. } => of(segment.start()).max(of(segment.end())),
    };
    match shape {
        Shape::Dot(point) => of(*point),
        _ => shape.segments().iter().map(points).fold(0.0, f64::max),
    }
}

fn bounds(outer: &Extents, shape: &Shape) -> bool {
    let inside = |point: Vector2<f64>| {
        (0..2).all(|axis| {
            point[axis] >= outer.min[axis] - CLIP_TOLERANCE && point[axis] <= outer.max[axis] + CLIP_TOLERANCE
        })
    };
    match shape {
        Shape::Dot(point) => inside(point.coords()),
        _ => shape.segments().iter().map(Segment::extents).all(|one| inside(one.min) && inside(one.max)),
    }
}

/// Whether shapes are inside a clip path that is a rectangle along the axes.
fn is_inside(shapes: &[Shape], clip: &Polygons) -> bool {
    let outer = area::extents(clip);
    let size = outer.size();
    let is_rectangle =
        clip.len() == 1 && (area::area(clip) - size.x * size.y).abs() <= 1e-9 * size.x * size.y;
    is_rectangle && shapes.iter().all(|shape| bounds(&outer, shape))
}
