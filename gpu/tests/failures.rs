//! Errors of adapters and devices, on a software driver.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::time::Duration;

use gpu::{AdapterKind, DeviceBuffer, DeviceRequirements, GpuDevice, GpuError};

const REQUIREMENTS: DeviceRequirements = DeviceRequirements {
    features: wgpu::Features::empty(),
    max_buffer_bytes: 1 << 31,
    timeout: Duration::from_secs(60),
};
/// Environment variable of the process whose address space is limited.
const IN_CHILD: &str = "HYPOGEUM_TEST_CHILD";

#[test]
fn missing_adapter_error_lists_those_found() {
    for kind in [AdapterKind::Hardware, AdapterKind::Software] {
        let error = GpuDevice::open(kind, Some(99), &REQUIREMENTS).unwrap_err();
        let GpuError::NoAdapter { wanted, found } = &error else { panic!("{error}") };
        assert!(wanted.ends_with(" 99"), "{error}");
        let adapters = gpu::adapters();
        assert!(adapters.iter().all(|adapter| found.contains(&adapter.name)), "{error}");
        assert!(!adapters.is_empty() || found == "there is no Vulkan driver", "{error}");
    }
}

/// The address space is that of a process of its own, which runs this test once more.
#[test]
#[ignore = "needs a Vulkan driver"]
fn device_out_of_memory_is_an_error() {
    if std::env::var_os(IN_CHILD).is_some() {
        return allocate_beyond_the_limit();
    }
    let mut child = std::process::Command::new(std::env::current_exe().unwrap());
    child
        .args(["--exact", "device_out_of_memory_is_an_error", "--ignored", "--nocapture"])
        .env(IN_CHILD, "1");
    let output = child.output().unwrap();
    let text =
        [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).concat();
    assert!(output.status.success() && text.contains("1 passed"), "{}: {text}", output.status);
}

fn allocate_beyond_the_limit() {
    const MIB: usize = 1 << 20;
    let gpu = GpuDevice::open(AdapterKind::Software, None, &REQUIREMENTS).unwrap();
    gpu.finish_uploads().unwrap();
    let n_pages: u64 =
        std::fs::read_to_string("/proc/self/statm").unwrap().split(' ').next().unwrap().parse().unwrap();
    let limit = n_pages * rustix::param::page_size() as u64 + 256 * MIB as u64;
    let limit = rustix::process::Rlimit { current: Some(limit), maximum: Some(limit) };
    rustix::process::setrlimit(rustix::process::Resource::As, limit).unwrap();
    let mut buffers = Vec::new();
    let error = loop {
        assert!(buffers.len() < 20, "no error after {} MiB", 32 * buffers.len());
        buffers.push(DeviceBuffer::zeroed(&gpu, "buffer", 8 * MIB));
        if let Err(error) = gpu.finish_uploads() {
            break error.to_string();
        }
    };
    assert!(error.contains("out of memory; this process holds "), "{error}");
    // The device stays failed.
    drop(buffers);
    assert_eq!(gpu.finish_uploads().unwrap_err().to_string().split(';').next(), error.split(';').next());
}
