//! The program as the benchmarks run it: the same three lines as `hypogeum`, built with this package.

fn main() -> std::process::ExitCode {
    orchestrator::main()
}
