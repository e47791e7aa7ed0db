#!/bin/sh
# Makes .venv with vLOD and all it needs, and the OpenGL driver for rendering without a window. Skips what is there.
# PYTHON: the interpreter to use; by default the first of python3, python3.13, ... python3.11 that is 3.11 or newer.
set -eu
cd "$(dirname "$0")/.."

fail() {
    echo "setup: $*" >&2
    exit 1
}

find_python() {
    for candidate in ${PYTHON:-python3 python3.13 python3.12 python3.11 python}; do
        if command -v "$candidate" >/dev/null 2>&1 &&
            "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return 0
        fi
    done
    return 1
}

# Runs apt-get as root, if this user may; fails otherwise.
install_packages() {
    command -v apt-get >/dev/null 2>&1 || return 1
    if [ "$(id -u)" = 0 ]; then
        as_root=""
    elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
        as_root="sudo"
    else
        return 1
    fi
    echo "setup: installing $*"
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get update -qq >/dev/null &&
        $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

python=.venv/bin/python
wanted=$(cat deploy/constraints.txt pyproject.toml | cksum)
stamp=.venv/vlod-setup

if [ ! -x "$python" ] || ! "$python" -c '' 2>/dev/null; then
    base=$(find_python) || fail "no Python 3.11 or newer found; install one, or name it: PYTHON=/path/to/python sh deploy/demo.sh"
    if ! "$base" -c 'import ensurepip, venv' 2>/dev/null; then
        version=$("$base" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        install_packages "python$version-venv" || fail "$base has no venv module; install python$version-venv"
    fi
    echo "setup: making .venv with $base"
    rm -rf .venv
    "$base" -m venv .venv || fail "cannot make .venv with $base"
fi

if [ ! -f "$stamp" ] || [ "$(cat "$stamp")" != "$wanted" ]; then
    echo "setup: installing vLOD and what it needs into .venv (some minutes at first)"
    "$python" -m pip install --quiet --disable-pip-version-check \
        -c deploy/constraints.txt -e '.[jobs,player,test]' || fail "pip could not install; see its message above"
    echo "$wanted" >"$stamp"
fi

# What runs often is compiled once, and kept beside the code.
code=$(find jobs storage player -name '*.py' | sort | xargs cat | cksum)
if [ ! -f .venv/vlod-compiled ] || [ "$(cat .venv/vlod-compiled)" != "$wanted $code" ]; then
    echo "setup: compiling what runs often (some minutes, after changes of the code)"
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
    for command in \
        "demo-scene offices $scratch/a.glb --triangles 20000" \
        "demo-scene plant $scratch/b.glb --triangles 20000" \
        "build $scratch/a.glb $scratch/a.store --executor serial --max-depth 2 --triangles-per-cell 2000" \
        "build $scratch/b.glb $scratch/b.store --executor serial --max-depth 2 --triangles-per-cell 2000" \
        "build $scratch/b.glb $scratch/b.store --executor serial --max-depth 1 --sampled" \
        "verify $scratch/a.store --cells 1 --samples 10" \
        "path $scratch/a.store --output $scratch/path.json"; do
        .venv/bin/vlod $command >"$scratch/log" 2>&1 || {
            cat "$scratch/log" >&2
            fail "vlod $command failed"
        }
    done
    rm -rf "$scratch"
    echo "$wanted $code" >.venv/vlod-compiled
fi

can_render() {
    "$python" - 2>/dev/null <<'END'
import moderngl
context = moderngl.create_context(standalone=True, backend="egl", require=330)
context.release()
END
}

if ! can_render; then
    packages="libegl1 libgl1 libgl1-mesa-dri"
    if ! install_packages $packages || ! can_render; then
        fail "OpenGL cannot draw without a window here; install these (Debian, Ubuntu): apt-get install $packages"
    fi
fi
