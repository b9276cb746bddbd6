use super::*;

/// The example of the specification: an index buffer of two triangles, written by the reference encoder.
#[test]
fn sequences_of_indices_follow_the_specification() {
    // Header, then the zigzag differences of 0, 1, 2, 2, 1, 3 with the first baseline, and four bytes of tail.
    let codes: [u8; 6] = [0 << 2, 2 << 1, 2 << 1, 0, 1 << 1, 4 << 1];
    let data = [&[0xd1u8][..], &codes, &[0; 4]].concat();
    assert_eq!(indices(&data, 6), Some(vec![0, 1, 2, 2, 1, 3]));
    assert_eq!(indices(&data[..10], 6), None);
    assert_eq!(indices(&data, 5), None);
}

#[test]
fn truncated_and_foreign_streams_are_refused() {
    for length in 0..64 {
        let zeros = vec![0xa0; length];
        let _ = attributes(&zeros, 100, 12);
        let _ = triangles(&vec![0xe1; length], 30);
        let _ = indices(&vec![0xd1; length], 30);
        assert_eq!(attributes(&vec![0xb0; length], 1, 4), None);
    }
    // A stream of constants: header, four groups without bits for each byte, and the tail.
    let constant = [&[0xa0u8][..], &[0; 4], &[0; 28], &[1, 2, 3, 4]].concat();
    assert_eq!(attributes(&constant, 16, 4), Some([1, 2, 3, 4].repeat(16)));
}

#[test]
fn exponents_and_octahedra_are_unfolded() {
    let coded = (-3i32 << 24 | 40).to_le_bytes();
    let mut data = coded.to_vec();
    scale_exponents(&mut data);
    assert_eq!(f32::from_le_bytes(data.try_into().unwrap()), 5.0);
    // One along z, and one below the plane.
    let mut normals = vec![0, 0, 127, 0, 127, 127u8, 127, 0];
    unfold_normals(&mut normals, 4);
    assert_eq!(normals, [0, 0, 127, 0, 0, 0, (-127i8) as u8, 0]);
}
