//! Halves of work at once, on the cores of the machine.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon_core::{ThreadPool, ThreadPoolBuilder};

use crate::geometry::fork::{Fork, InTurn};

/// More threads than this would share halves that are small.
const MOST_THREADS: usize = 8;
/// As much as a main thread has: a thread that waits for a half begins another one.
const STACK: usize = 8 << 20;

/// Does halves of work at once, in threads that the first work starts and all later work uses: one for each core of the machine,
/// eight at most. With one core, where the system allows no threads, and while other work is in them, it does one half after the
/// other.
///
/// ```
/// use isomark::cores::Cores;
/// use isomark::geometry::facing_part::FacingPart;
/// use isomark::geometry::shapes;
/// use isomark::geometry::space::View;
/// use isomark::geometry::surface::fit::{FitOptions, FittedSurface};
///
/// let mesh = shapes::graph(20.0, 1.0, shapes::mouse);
/// let part = FacingPart::with_fork(&mesh, &View::top(), &Cores);
/// let surface = FittedSurface::of_part(&part, &FitOptions::default())?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cores;

/// Whether work is in the threads. Other work stays in its own thread meanwhile: it would have to wait for all halves of the first.
static ARE_BUSY: AtomicBool = AtomicBool::new(false);

/// Keeps a flag set.
struct Busy<'f>(&'f AtomicBool);

impl<'f> Busy<'f> {
    /// `None` where the flag is set.
    fn claim(flag: &'f AtomicBool) -> Option<Self> {
        // Not `then_some`: a value that is not wanted would clear the flag when it is dropped.
        (!flag.swap(true, Ordering::Acquire)).then(|| Self(flag))
    }
}

impl Drop for Busy<'_> {
    /// Also after a panic.
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

/// The threads, for one work at a time; `None` where there are none, where work is in them, and within them.
fn free_threads() -> Option<(&'static ThreadPool, Busy<'static>)> {
    let threads = threads().filter(|_| !is_within())?;
    Some((threads, Busy::claim(&ARE_BUSY)?))
}

impl Fork for Cores {
    fn start(&self, work: &mut (dyn FnMut() + Send)) {
        match free_threads() {
            Some((threads, _busy)) => threads.install(work),
            None => work(),
        }
    }

    fn both(&self, one: &mut (dyn FnMut() + Send), other: &mut (dyn FnMut() + Send)) {
        if is_within() {
            rayon_core::join(one, other);
        } else if let Some((threads, _busy)) = free_threads() {
            threads.join(one, other);
        } else {
            InTurn.both(one, other);
        }
    }
}

/// Whether this is one of the threads.
fn is_within() -> bool {
    rayon_core::current_thread_index().is_some()
}

/// `None` where there is one core, or where the system allows no threads.
fn threads() -> Option<&'static ThreadPool> {
    static THREADS: OnceLock<Option<ThreadPool>> = OnceLock::new();
    let start = || {
        let count = std::thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS);
        let name = |index| format!("fit {index}");
        let builder = ThreadPoolBuilder::new().num_threads(count).thread_name(name).stack_size(STACK);
        if count > 1 { builder.build().ok() } else { None }
    };
    THREADS.get_or_init(start).as_ref()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::facing_part::FacingPart;
    use crate::geometry::shapes;
    use crate::geometry::space::View;
    use crate::geometry::surface::fit::{FitOptions, FittedSurface};

    #[test]
    fn only_who_has_set_the_flag_clears_it() {
        let flag = AtomicBool::new(false);
        let first = Busy::claim(&flag);
        assert!(first.is_some() && Busy::claim(&flag).is_none() && Busy::claim(&flag).is_none());
        drop(first);
        assert!(Busy::claim(&flag).is_some() && Busy::claim(&flag).is_some());
    }

    #[test]
    fn halves_at_once_have_the_result_of_halves_in_turn() {
        for height in [shapes::mouse, shapes::mandarin] {
            let mesh = shapes::graph(20.0, 0.5, height);
            let alone = FacingPart::new(&mesh, &View::top());
            let shared = FacingPart::with_fork(&mesh, &View::top(), &Cores);
            let [alone, shared] = [&alone, &shared]
                .map(|part| FittedSurface::of_part(part, &FitOptions::default()).expect("a surface"));
            assert_eq!(alone, shared);
        }
    }
}
