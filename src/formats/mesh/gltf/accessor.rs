//! Numbers out of glTF buffers, every length checked before anything is allocated.

use std::borrow::Cow;

use gltf_json::accessor::{Accessor, ComponentType, Type};
use gltf_json::validation::Checked;
use gltf_json::{Index, Root, buffer::View};

use crate::formats::mesh::MeshReadError;

/// The JSON and its buffers.
pub(super) struct Data<'a> {
    pub(super) root: &'a Root,
    pub(super) buffers: &'a [Cow<'a, [u8]>],
}

impl<'a> Data<'a> {
    /// Triples of floats, such as positions; `item` says what they are for.
    pub(super) fn vectors(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<[f32; 3]>, MeshReadError> {
        let accessor = self.accessor(index, item)?;
        let kind = kind_of(accessor);
        if kind != (Some(ComponentType::F32), Some(Type::Vec3)) {
            return Err(wrong_data(item, "three 32-bit floats", kind));
        }
        self.elements(accessor, 12, item, |bytes| {
            [0, 4, 8].map(|at| f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]))
        })
    }

    /// Unsigned whole numbers, such as vertex indices.
    pub(super) fn indices(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<Vec<u32>, MeshReadError> {
        let accessor = self.accessor(index, item)?;
        match kind_of(accessor) {
            (Some(ComponentType::U8), Some(Type::Scalar)) => self.elements(accessor, 1, item, u32_of),
            (Some(ComponentType::U16), Some(Type::Scalar)) => self.elements(accessor, 2, item, u32_of),
            (Some(ComponentType::U32), Some(Type::Scalar)) => self.elements(accessor, 4, item, u32_of),
            kind => Err(wrong_data(item, "unsigned whole numbers", kind)),
        }
    }

    fn accessor(
        &self,
        index: Index<Accessor>,
        item: &dyn Fn() -> String,
    ) -> Result<&'a Accessor, MeshReadError> {
        self.root.accessors.get(index.value()).ok_or_else(|| MeshReadError::BrokenReference {
            item: item(),
            kind: "accessor",
            index: index.value(),
            count: self.root.accessors.len(),
        })
    }

    fn elements<T: Copy + Default>(
        &self,
        accessor: &Accessor,
        size: usize,
        item: &dyn Fn() -> String,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, MeshReadError> {
        let count = accessor.count.0;
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |offset| offset.0);
                self.run(view, offset, count, size, item)?.map(&decode).collect()
            }
            None => {
                // Without a view all values are zero, and only sparse ones make sense of it.
                if accessor.sparse.is_none() {
                    return Err(MeshReadError::NoData { item: item() });
                }
                let longest = self.buffers.iter().map(|buffer| buffer.len() as u64).max().unwrap_or(0);
                // Zeros cost no file bytes; more of them than the buffers have bytes are damage.
                if count > longest {
                    return Err(MeshReadError::DataBeyondBuffer {
                        item: item(),
                        needed: count,
                        available: longest,
                    });
                }
                vec![T::default(); count as usize]
            }
        };
        if let Some(sparse) = &accessor.sparse {
            let (indices, count) = (&sparse.indices, sparse.count.0);
            let index_size = match &indices.component_type {
                Checked::Valid(kind) => kind.0.size(),
                Checked::Invalid => return Err(wrong_data(item, "unsigned sparse indices", (None, None))),
            };
            let places = self.run(indices.buffer_view, indices.byte_offset.0, count, index_size, item)?;
            let replaced =
                self.run(sparse.values.buffer_view, sparse.values.byte_offset.0, count, size, item)?;
            for (place, bytes) in places.map(u32_of).zip(replaced) {
                let places = values.len();
                let value = values.get_mut(place as usize).ok_or_else(|| MeshReadError::BrokenReference {
                    item: item(),
                    kind: "sparse element",
                    index: place as usize,
                    count: places,
                })?;
                *value = decode(bytes);
            }
        }
        Ok(values)
    }

    /// `count` elements of `size` bytes each, `offset` bytes into a view.
    fn run(
        &self,
        view: Index<View>,
        offset: u64,
        count: u64,
        size: usize,
        item: &dyn Fn() -> String,
    ) -> Result<impl ExactSizeIterator<Item = &'a [u8]> + use<'a>, MeshReadError> {
        let views = &self.root.buffer_views;
        let broken = |kind, index, count| MeshReadError::BrokenReference { item: item(), kind, index, count };
        let view = views.get(view.value()).ok_or_else(|| broken("buffer view", view.value(), views.len()))?;
        let buffer = self
            .buffers
            .get(view.buffer.value())
            .ok_or_else(|| broken("buffer", view.buffer.value(), self.buffers.len()))?;
        let start = view.byte_offset.map_or(0, |offset| offset.0);
        let end = start.saturating_add(view.byte_length.0);
        let beyond = |needed, available| MeshReadError::DataBeyondBuffer { item: item(), needed, available };
        let bytes = slice(buffer, start, end).ok_or_else(|| beyond(end, buffer.len() as u64))?;

        let stride = view.byte_stride.map_or(size, |stride| stride.0.max(size));
        // The last element may end before its stride does.
        let span = count.saturating_sub(1).saturating_mul(stride as u64).saturating_add(size as u64);
        let end = if count == 0 { offset } else { offset.saturating_add(span) };
        let bytes = slice(bytes, offset, end).ok_or_else(|| beyond(end, bytes.len() as u64))?;
        Ok(bytes.chunks(stride).map(move |chunk| &chunk[..size]))
    }
}

fn slice(bytes: &[u8], start: u64, end: u64) -> Option<&[u8]> {
    bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)
}

fn u32_of(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

fn kind_of(accessor: &Accessor) -> (Option<ComponentType>, Option<Type>) {
    let component = match &accessor.component_type {
        Checked::Valid(component) => Some(component.0),
        Checked::Invalid => None,
    };
    let shape = match accessor.type_ {
        Checked::Valid(shape) => Some(shape),
        Checked::Invalid => None,
    };
    (component, shape)
}

fn wrong_data(
    item: &dyn Fn() -> String,
    expected: &'static str,
    (component, shape): (Option<ComponentType>, Option<Type>),
) -> MeshReadError {
    let name = |known: Option<String>| known.unwrap_or_else(|| "an unknown type".into());
    let component = name(component.map(|component| format!("{component:?}").to_lowercase()));
    let shape = name(shape.map(|shape| format!("{shape:?}").to_lowercase()));
    MeshReadError::WrongData { item: item(), expected, found: format!("{shape} of {component}") }
}
