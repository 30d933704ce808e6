//! The `hypogeum` binary, built as part of this package so that benchmarks can run it.

fn main() -> std::process::ExitCode {
    orchestrator::main()
}
