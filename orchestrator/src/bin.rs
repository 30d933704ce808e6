//! The binary `hypogeum`; everything it does lives in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    orchestrator::main()
}
