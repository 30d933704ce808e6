//! The binary under test: the same entry point as `hypogeum`, declared here so that cargo builds it for these
//! tests.

fn main() -> std::process::ExitCode {
    orchestrator::main()
}
