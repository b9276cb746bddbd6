//! The program: parse, run, exit code.

/// More than any block of a usual job, bytes.
const LARGE: usize = 4 << 20;

fn main() -> std::process::ExitCode {
    // The GNU C library returns large blocks to the system, and each new one costs a page fault for every 4 KiB, until a block of
    // that size was freed once.
    drop(std::hint::black_box(Vec::<u8>::with_capacity(LARGE)));
    isomark::cli::main()
}
