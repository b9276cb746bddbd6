//! DXF: the scan knows what is in the file and where, the `dxf` crate reads the entities it is able to read.

pub(super) mod write;
