"""The manifest of `submit kubernetes`, against the schemas of several versions of Kubernetes."""

from typing import Any

import pytest

from sweep import OPTIONS, Sweep

kubernetes_validate = pytest.importorskip("kubernetes_validate", reason="pip install kubernetes-validate")
yaml = pytest.importorskip("yaml", reason="pip install pyyaml")

N_SHARDS = 4
# Earlier versions have no limits of retries per index.
OLDEST = "1.29.0"


def items(manifest: str) -> list[dict[str, Any]]:
    """Returns the objects of a manifest, those in lists as well."""
    documents = [document for document in yaml.safe_load_all(manifest) if document]
    return [item for document in documents for item in document.get("items", [document])]


def test_manifest_is_valid(sweep: Sweep) -> None:
    submission = ["submit", "kubernetes", "sweep.toml", "--shards", str(N_SHARDS), "--dry-run"]
    submission += ["--image", "registry.example/hypogeum:1", "--claim", "home", "--cpus", "2", "--memory", "4Gi"]
    found = items(sweep.hypogeum(*submission, "--", *OPTIONS))
    assert not sweep.shards.exists()

    for version in (OLDEST, kubernetes_validate.latest_version()):
        for item in found:
            kubernetes_validate.validate(item, version, strict=True)
    indexed = [item["spec"] for item in found if item["spec"].get("completionMode") == "Indexed"]
    assert [spec["completions"] for spec in indexed] == [N_SHARDS]
