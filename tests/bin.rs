//! The binary under test: the same three lines as `hypogeum`, so that cargo builds it for this package's tests.

fn main() -> std::process::ExitCode {
    orchestrator::main()
}
