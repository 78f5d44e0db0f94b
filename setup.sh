#!/bin/bash
# Sets up what is missing and nothing else: Debian packages, then a virtual environment in .venv.
#     ./setup.sh          what a run needs
#     ./setup.sh tests    and what the tests need besides
#     ./setup.sh rivals   and the other solvers that `orchestrator study large` compares with
# Exit code 2 when packages are missing and cannot be installed from here.
set -euo pipefail
cd "$(dirname "$0")"

python=${PYTHON:-python3}
packages=(
    freefem++ libfreefem++ libfreefem++-dev    # the solver, its plugins, its .idp files
    libopenblas0-serial                        # CHOLMOD factorises about 6 times faster than with the default BLAS
    libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libxi6 libxext6   # loaded by the gmsh wheel
    libgl1 libegl1 libgl1-mesa-dri             # figures are rendered off screen through EGL
)
if [[ ${1:-} == tests ]]; then
    packages+=(calculix-ccx)                   # another black box
elif [[ ${1:-} == rivals ]]; then
    packages+=(python3-petsc4py openmpi-bin)   # PETSc with its multigrid, hypre and MUMPS, for Debian's own Python
fi
# What CHOLMOD's binding is built with. A run does without it, many subdomains take longer then.
faster=(libsuitesparse-dev gcc libc6-dev python3-dev)

missing_packages() {
    local package
    for package in "$@"; do
        [[ $(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || echo "$package"
    done
}

missing_python() {
    command -v "$python" >/dev/null || echo python3
    "$python" -c 'import venv, ensurepip' 2>/dev/null || echo python3-venv
}

may_install() {
    # sudo may ask for a password only where someone can type it.
    [[ $(id -u) -eq 0 ]] || { command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [[ -t 0 ]]; }; }
}

install_packages() {
    local as_root=()
    if ! may_install; then
        echo "Missing Debian packages: $*" >&2
        echo "Neither root nor sudo here. Ask an administrator to run:" >&2
        echo "    apt-get update && apt-get install --no-install-recommends $*" >&2
        exit 2
    fi
    [[ $(id -u) -eq 0 ]] || as_root=(sudo)
    echo "Installing Debian packages: $*"
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -qq
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

if command -v dpkg-query >/dev/null; then
    mapfile -t missing < <(missing_packages "${packages[@]}"; missing_python)
    mapfile -t wanted < <(missing_packages "${faster[@]}")
    if may_install || [[ ${#missing[@]} -gt 0 ]]; then missing+=("${wanted[@]}"); fi
    [[ ${#missing[@]} -eq 0 ]] || install_packages "${missing[@]}"
elif ! command -v FreeFem++ >/dev/null; then
    echo "Not a Debian system: install the equivalents of ${packages[*]}, then call this again." >&2
    exit 2
fi

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "$("$python" --version) found, 3.11 or later needed: PYTHON=/path/to/python3 make ..." >&2
    exit 2
}

# The stamp holds what the environment was made from; any difference makes it anew.
wanted=$({ "$python" --version; pwd; cat pyproject.toml constraints.txt; } | sha256sum)
if [[ $(cat .venv/stamp 2>/dev/null) != "$wanted" ]]; then
    echo "Setting up the virtual environment .venv"
    "$python" -m venv --clear .venv
    .venv/bin/python -m pip install --quiet --no-input --disable-pip-version-check \
        --constraint constraints.txt --editable '.[test,mpi]'
    .venv/bin/python -m pip install --quiet --no-input --disable-pip-version-check \
        --constraint constraints.txt --editable '.[cholmod]' >.venv/cholmod.log 2>&1 ||
        echo "CHOLMOD's binding could not be built (.venv/cholmod.log): SuperLU takes its place"
    echo "$wanted" > .venv/stamp
fi
if [[ ${1:-} == rivals ]]; then
    .venv/bin/python -m pip install --quiet --no-input --disable-pip-version-check \
        --constraint constraints.txt --editable '.[rivals]'
fi
# Where Python may not keep its bytecode (containers often forbid it), every start would compile the package anew.
.venv/bin/python -m compileall -q orchestrator || true
# Loops over node pairs and blocks are compiled at their first call and kept beside their source: by a few iterations of the first
# contact scenes, so that nobody's first run takes longer than the next. Tests call what they test, and keep it as well.
if [[ ${1:-} != tests && -w orchestrator && -w .venv ]]; then
    mapfile -t loops < <(grep -rl --include='*.py' '^@compiled' orchestrator)
    if [[ ! -e .venv/compiled || -n $(find "${loops[@]}" -newer .venv/compiled) ]]; then
        echo "Compiling loops over node pairs"
        results=$(mktemp -d)
        for scene in polycrystal_10 two_blocks; do
            .venv/bin/orchestrator run configs/$scene.yaml --quiet --output "$results/$scene" --set method.max_iterations=4 \
                --set output.figures=false >/dev/null 2>&1 || true  # 1: not converged, by far
        done
        rm -rf "$results"
        touch .venv/compiled
    fi
fi
