//! Bends flat drawings so that a galvo laser marks true lengths on curved parts.

pub mod geometry;
pub mod reason;
pub mod formats;
pub mod config;
pub mod files;
pub mod cache;
pub mod preview;
pub mod diff;
pub mod report;
pub mod pipeline;
pub mod hotfolder;
pub mod cli;
