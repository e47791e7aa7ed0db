#!/bin/sh
# Checks everything: style, types, fast tests, slow tests. Stops at the first that fails, and says which.
# VLOD_MODELS: a folder of real models; tests that need one are skipped without it.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh

stage() {
    name=$1
    shift
    echo "== $name"
    "$@" || {
        echo "test: FAILED at: $name" >&2
        exit 1
    }
}

stage "ruff check" .venv/bin/ruff check .
stage "ruff format" .venv/bin/ruff format --check .
stage "mypy" .venv/bin/mypy
stage "fast tests" .venv/bin/pytest -q -m "not slow"
stage "slow tests" .venv/bin/pytest -q -m slow
