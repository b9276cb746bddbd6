//! The plugins work with the built program, inside the programs that they belong to.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    unreachable_pub,
    missing_docs,
    reason = "helpers of tests may panic"
)]

#[cfg(target_os = "linux")]
#[path = "../ezdxf/mod.rs"]
mod ezdxf;
#[cfg(target_os = "linux")]
#[path = "../khronos/mod.rs"]
mod khronos;

mod blender;
#[cfg(target_os = "linux")]
mod freecad;
