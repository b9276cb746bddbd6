//! The areas of clip paths (SVG 1.1, chapter 14.3).

use std::borrow::Cow;

use i_overlay::core::fill_rule::FillRule;
use nalgebra::{Matrix2, Vector2};
use roxmltree::Node;

use super::super::budget::Cost;
use super::super::error::PatternReadError;
use super::area::{self, Polygons};
use super::document::attribute;
use super::place;
use super::style::{Style, is_svg};
use super::walk::{Context, DEFINITIONS, Walk, contours, link, transformed};
use crate::geometry::pattern::{Affine, Shape};

impl<'a, 'd> Walk<'a, 'd> {
    /// The style of a definition, which inherits from the elements around it and not from those that refer to it.
    fn inherited(&mut self, node: Node<'a, 'd>, context: &Context) -> Result<Style, PatternReadError> {
        let mut around: Vec<Node<'a, 'd>> = node.ancestors().filter(|outer| is_svg(*outer)).collect();
        self.spend(Cost::Unfolded, around.len(), node, context)?;
        let mut at = Context { style: Style::default(), ..context.clone() };
        while let Some(node) = around.pop() {
            at.style = self.style(node, &at)?;
        }
        Ok(at.style)
    }

    /// The area of a clip path in mm, or the reason why it cannot be read.
    pub(super) fn clip(
        &mut self,
        clip: Node<'a, 'd>,
        context: &Context,
    ) -> Result<Result<Polygons, Cow<'static, str>>, PatternReadError> {
        if attribute(clip, "clipPathUnits") == Some("objectBoundingBox") {
            return Ok(Err(
                "its clip path is relative to its size, which is not read: cut it in the drawing program"
                    .into(),
            ));
        }
        let style = self.inherited(clip, context)?;
        let Ok(own) = place::own(&style, context.viewport) else {
            return Ok(Err("the transform of its clip path cannot be read".into()));
        };
        let unread = || {
            Ok(Err("its clip path contains more than shapes, or shapes that cannot be read: cut it in the drawing program".into()))
        };
        if style.clip.is_some() || style.is_clip_unread() {
            return unread();
        }
        let map = own.map_or(context.map, |own| context.map.after(&own));
        let inner = Context { map, style, ..context.clone() };
        let mut polygons = Polygons::new();
        for child in clip.children().filter(|child| is_svg(*child)) {
            self.spend(Cost::Unfolded, 1, child, &inner)?;
            let (mut map, mut child, mut outer) = (inner.map, child, inner.clone());
            if DEFINITIONS.contains(&child.tag_name().name()) {
                continue;
            }
            if child.tag_name().name() == "use" {
                // Inkscape clips with copies of shapes.
                let style = self.style(child, &outer)?;
                let [x, y] = ["x", "y"].map(|name| self.length(child, name, 0.0, &outer));
                let (Ok(x), Ok(y)) = (x, y) else { return unread() };
                let (x, y) = (x.unwrap_or(0.0), y.unwrap_or(0.0));
                let own = place::own(&style, outer.viewport);
                let target = link(child).strip_prefix('#').and_then(|id| self.ids.get(id).copied());
                let (Ok(own), Some(target), false) = (own, target, style.is_clip_unread()) else {
                    return unread();
                };
                let shift = Affine { linear: Matrix2::identity(), offset: Vector2::new(x, y) };
                map = own.map_or(map, |own| map.after(&own)).after(&shift);
                outer = Context { style, ..outer };
                child = target;
            }
            let style = self.style(child, &outer)?;
            let own = place::own(&style, outer.viewport);
            let is_unread = style.has_css_clip || style.is_clip_unread();
            let (Ok(own), None, false) = (own, &style.clip, is_unread) else { return unread() };
            if !matches!(
                child.tag_name().name(),
                "path" | "rect" | "circle" | "ellipse" | "polyline" | "polygon" | "line"
            ) {
                return unread();
            }
            if !style.displayed || !style.visible {
                continue;
            }
            map = own.map_or(map, |own| map.after(&own));
            let rule = style.clip_rule;
            let of_child = Context { map, style, ..outer };
            let (shapes, read) = self.shapes(child, &of_child);
            if read.is_err() {
                return unread();
            }
            let closed: Vec<Shape> = contours(&shapes).iter().map(|shape| transformed(shape, &map)).collect();
            self.check_reach(&closed, child, context)?;
            let one =
                area::flattened(&closed, self.budget).and_then(|flat| area::united(&flat, rule, self.budget));
            polygons.extend(self.within(one, child, context)?);
        }
        let all = area::united(&polygons, FillRule::NonZero, self.budget);
        Ok(Ok(self.within(all, clip, context)?))
    }
}
