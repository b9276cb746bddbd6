//! What the station remembers: the journal, the process that runs it, its status, and the requests from people.

mod drop_id;
mod holder;
mod lock;
mod journal;
mod parts;
pub(crate) mod requests;
mod shares;
pub mod status;

pub(crate) use drop_id::{DropId, with_slashes};
pub use holder::Holder;
pub(crate) use journal::{
    Arrival, Certainty, Delivered, EndedJob, Import, Job, Journal, JournalPositions, Listing, NewListing,
    OpenJob, Series, Stage, StampRecord, checksum, keep_short,
};
pub(crate) use lock::HotLock;
pub use lock::StationLock;
#[cfg(feature = "cli")]
pub(crate) use lock::is_hot_folder_held;
pub(crate) use parts::PartNote;
pub use requests::Request;
pub(crate) use shares::Shares;
#[cfg(feature = "cli")]
pub(crate) use shares::{UsedFolder, known_share_is_there};
pub(crate) use status::{StatusBoard, UncertainDrawing, UnderWay};
