//! What two sequences have in common, in order.

use similar::DiffOp;
use similar::algorithms::{Capture, Compact, Replace, myers};

/// The operations that change the old sequence into the new one, in order (Eugene W. Myers, "An O(ND) Difference
/// Algorithm and Its Variations", 1986).
///
/// The items are compared by their numbers: with one type for all sequences, the algorithm is compiled only once.
pub(super) fn operations<K: Ord>(old: &[K], new: &[K]) -> Vec<DiffOp> {
    let [old, new] = numbered([old, new], |item| item);
    let mut hook = Compact::new(Replace::new(Capture::new()), &old[..], &new[..]);
    let Ok(()) = myers::diff(&mut hook, &old[..], 0..old.len(), &new[..], 0..new.len());
    hook.into_inner().into_inner().into_ops()
}

/// A number for each key, in the order of the keys, so that it does not depend on the order of the sequences.
pub(super) fn numbered<'a, T, K: Ord + ?Sized + 'a>(
    sides: [&'a [T]; 2],
    key: impl Fn(&'a T) -> &'a K,
) -> [Vec<usize>; 2] {
    let mut keys: Vec<&K> = sides.iter().flat_map(|side| side.iter().map(&key)).collect();
    keys.sort();
    keys.dedup();
    sides.map(|side| side.iter().map(|item| keys.partition_point(|other| *other < key(item))).collect())
}
