//! Tests of the built program on real exports, by command and by hot folder.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    unreachable_pub,
    missing_docs,
    reason = "helpers of tests may panic"
)]

mod desk;
mod glb;
#[path = "../ezdxf/mod.rs"]
mod ezdxf;
#[path = "../schemas/mod.rs"]
mod schemas;
#[path = "../khronos/mod.rs"]
mod khronos;
#[path = "../browser/mod.rs"]
mod browser;
#[path = "../times/mod.rs"]
mod times;

mod correct;
mod on_part;
mod simulated_laser;
mod calibrate;
mod register;
mod refusals;
mod settings;
mod retention;
mod schema;
mod beam;
mod cache;
mod slips;
mod current_part;
mod inspect_and_diff;
mod station;
mod control;
mod page;
mod report_page;
mod demo;
mod evaluate;
mod explain;
mod frame;
mod align;
mod mark_region;
mod sides;
mod losses;
mod misplacement;
mod names;
mod outputs;
mod fill;
mod rotary;
mod plan;
mod step;
mod drilled;
mod beside_edges;
