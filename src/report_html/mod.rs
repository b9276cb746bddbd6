//! The report of one job as one HTML file for people: the mark on the part in 3-D, the values that matter first, the flat
//! panels, the notices with their places, and what was read.
//!
//! The file needs nothing else and loads nothing: script, style, pictures and data are inside, and its content security
//! policy allows only its own script. Without WebGL2 or scripts, the flat panels and all values remain. Equal inputs give
//! equal bytes, so times are left out.
//!
//! | file | is |
//! |---|---|
//! | `viewer.js` | the 3-D view: reads the GLB and draws it |
//! | `base.css` | the style that the report and the page of a station share: colours, light and dark |
//! | `report.css` | the style of the report: phone, paper |

mod content;
mod markup;
mod spots;
mod page;
mod sides;

#[cfg(feature = "page")]
pub(crate) use markup::{BASE_STYLE, Markup, compact, hash, safe};

pub use content::{Landmarks, PageContent, Plane};
pub use markup::MAX_FRAME;
pub use sides::sides_html;

/// The report as an HTML document. It takes at most [`MAX_FRAME`] bytes in addition to the panels and to the GLB in
/// base64; long lists are cut and state how many items are left out.
#[must_use]
pub fn html(content: &PageContent<'_>) -> String {
    page::page(content)
}
