//! Settings: a station file and one file per SKU become one validated [`Station`] and one [`JobSettings`] per job.
//!
//! ```text
//! station.toml  ──▶ Station { folders, watch, settings: JobSettings }
//! skus/<sku>.toml ──────────▶ JobSettings of that SKU (overrides any key of the part, the drawing, its fill and its correction)
//! ```
//!
//! In the files angles are in degrees and every key names its unit; inside the program lengths are in mm and angles in rad.
//! Every mistake is a [`ConfigError`] that names file, line and column and states what is allowed. [`LiveSettings`]
//! follows the files while a station runs; [`Overrides`] are the settings of the command line.

pub mod canonical;
mod choices;
mod content;
mod content_keys;
#[cfg(feature = "station")]
mod row;
mod sku;
mod settings;
mod fill;
mod fill_keys;
mod fleet;
mod route;
mod page;
mod station;
mod released;
mod lens_table;
mod edit;
#[cfg(feature = "station")]
mod changes;
mod keys;
mod live;
mod overrides;
mod text;
mod typed;
mod error;
mod suggest;

#[cfg(feature = "station")]
pub(crate) use changes::changed_settings;
pub use choices::{
    Aim, Align, Backend, BadRows, Converter, DeliveryKind, DxfVersion, FieldOrigin, FloaterWeights,
    FocusSteps, LocalSettings, Losses, Method, Outdated, OutsideMark, PartShape, Repeat, Slip, Smoothing,
    StrokesChoice, TilesAs, UnknownChoice, Vertices, Weighting, parse_axis, parse_facing,
};
pub use content::{CodeSettings, ContentSettings, Placeholder, SerialSettings, ShiftSettings};
pub use edit::{NewValue, edited};
pub use error::{ConfigError, Excerpt, Spot};
pub use fill::{FillSettings, FocusSettings};
pub use fleet::FleetSettings;
pub use lens_table::LENS_TABLE_COLUMNS;
#[cfg(feature = "cli")]
pub(crate) use lens_table::read as read_lens_table;
#[cfg(any(feature = "cli", feature = "fleet"))]
pub(crate) use live::sku_files;
pub use live::{LiveSettings, SettingsEvent};
#[cfg(feature = "station")]
pub(crate) use live::{misnamed_settings, without_ending};
pub use overrides::Overrides;
pub use page::{Authority, BadAuthority, HostName, PageSettings, PasswordSource};
pub use released::ReleasedSettings;
pub use route::Route;
#[cfg(feature = "station")]
pub(crate) use row::with_row;
pub use settings::{
    Anchor, CorrectionSettings, Field, IncidenceLimits, JobSettings, Optics, Output, PartSettings,
    PatternSettings, Placement, Rotary, Tiles, ViewSource,
};
#[cfg(feature = "station")]
pub(crate) use sku::fold;
#[cfg(feature = "cli")]
pub(crate) use sku::is_reserved_by_windows;
pub use sku::{BadSku, Sku};
#[cfg(feature = "cli")]
pub(crate) use station::read as read_settings;
pub use station::{DeliverySettings, FolderPaths, LogSettings, Retention, Station, Verify, Watch};
#[cfg(feature = "station")]
pub(crate) use suggest::{near, nearest_first};
pub use typed::setting_names;

#[cfg(test)]
mod tests;
