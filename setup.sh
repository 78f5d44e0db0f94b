#!/bin/bash
# Sets up what is missing and nothing else: Debian packages, then a virtual environment in .venv.
#     ./setup.sh          what a run needs
#     ./setup.sh run      the same, but for what the first run in contact needs, which goes on behind
#     ./setup.sh tests    and what the tests need besides
#     ./setup.sh rivals   and the other solvers that `orchestrator study large` compares with
#     ./setup.sh cluster  another environment, .venv-cluster, of Debian's own Python with its PETSc and MPI, for many ranks
# Exit code 2 when packages are missing and cannot be installed from here.
set -euo pipefail
cd "$(dirname "$0")"

python=${PYTHON:-python3} environment=.venv sites=() numpy="&"
if [[ ${1:-} == cluster ]]; then
    python=/usr/bin/python3 environment=.venv-cluster sites=(--system-site-packages) numpy="numpy<2"    # what Debian's bindings go with
fi
packages=(
    freefem++ libfreefem++ libfreefem++-dev    # the solver, its plugins, its .idp files
    libopenblas0-serial                        # FreeFEM and CHOLMOD factorise about 6 times faster than with the default BLAS
    libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 libxi6 libxext6   # loaded by the gmsh wheel
    libgl1 libegl1 libgl1-mesa-dri             # figures are rendered off screen through EGL
)
if [[ ${1:-} == tests ]]; then
    packages+=(calculix-ccx)                   # another black box
elif [[ ${1:-} == rivals ]]; then
    packages+=(python3-petsc4py openmpi-bin)   # PETSc with its multigrid, hypre and MUMPS, for Debian's own Python
elif [[ ${1:-} == cluster ]]; then
    packages+=(python3-petsc4py python3-mpi4py openmpi-bin)
fi
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

refuse_to_install() {
    echo "Missing Debian packages: $*" >&2
    echo "Neither root nor sudo here. Ask an administrator to run:" >&2
    echo "    apt-get update && apt-get install --no-install-recommends $*" >&2
    exit 2
}

as_root() {
    if [[ $(id -u) -eq 0 ]]; then env DEBIAN_FRONTEND=noninteractive "$@"; else sudo env DEBIAN_FRONTEND=noninteractive "$@"; fi
}

install_packages() {
    echo "Installing Debian packages: $*"
    as_root apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

debian=
if command -v dpkg-query >/dev/null; then
    mapfile -t missing < <(missing_packages "${packages[@]}")
    mapfile -t first < <(missing_python)
    if [[ ${#missing[@]} -gt 0 || ${#first[@]} -gt 0 ]]; then
        may_install || refuse_to_install "${first[@]}" "${missing[@]}"
        as_root apt-get update -qq
    fi
    [[ ${#first[@]} -eq 0 ]] || install_packages "${first[@]}"
    if [[ ${#missing[@]} -gt 0 ]]; then
        install_packages "${missing[@]}" </dev/null &    # while Python's packages are fetched
        debian=$!
    fi
elif ! command -v FreeFem++ >/dev/null; then
    echo "Not a Debian system: install the equivalents of ${packages[*]}, then call this again." >&2
    exit 2
fi

"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "$("$python" --version) found, 3.11 or later needed: PYTHON=/path/to/python3 make ..." >&2
    exit 2
}

# The stamp holds what the environment was made from; any difference makes it anew. Tests need more packages than a run does, which
# they add to it.
extras=all
[[ ${1:-} == tests ]] && extras=all,test
[[ ${1:-} == rivals ]] && extras=all,test,rivals
[[ ${1:-} == cluster ]] && extras=mesh,figures,fast
made=$({ "$python" --version; pwd; cat pyproject.toml constraints.txt; } | sha256sum)
if [[ $(head -1 $environment/stamp 2>/dev/null) != "$made" ]]; then
    echo "Setting up the virtual environment $environment"
    "$python" -m venv --clear --without-pip "${sites[@]}" $environment
    sed "s/^numpy==.*/$numpy/" constraints.txt > $environment/constraints.txt
    echo "$made" > $environment/stamp.new
elif ! tail -1 $environment/stamp | grep -qE "^$extras(,|\$)"; then
    echo "Adding to the virtual environment $environment"
    head -1 $environment/stamp > $environment/stamp.new
fi

by_pip() {    # of Python's own, which takes seconds to install
    $environment/bin/python -c 'import pip' 2>/dev/null || $environment/bin/python -m ensurepip >/dev/null
    $environment/bin/python -m pip install --no-input --disable-pip-version-check "$@"
}

# uv takes a fifth of pip's time, but does not know where pip has been told to look for packages:
# where it fails pip does it.
install() {
    local uv cache=() asked=(--quiet --constraint $environment/constraints.txt "$@")
    if ! uv=$(command -v uv); then
        "$python" -m pip --python $environment/bin/python install --no-input \
            --disable-pip-version-check "${asked[@]:0:3}" uv 2>/dev/null ||
            by_pip "${asked[@]:0:3}" uv || true
        uv=$environment/bin/uv
        cache=(--cache-dir $environment/uv-cache)    # nobody asked for one
    fi
    VIRTUAL_ENV=$PWD/$environment "$uv" pip install "${cache[@]}" "${asked[@]}" pip \
        2>$environment/uv.log || by_pip "${asked[@]}"
    rm -rf $environment/uv-cache >/dev/null 2>&1 &    # seconds, of thousands of files that nobody waits for
}

if [[ -e $environment/stamp.new ]]; then
    install --editable ".[$extras]"
    echo "$extras" >> $environment/stamp.new
    mv $environment/stamp.new $environment/stamp
fi
[[ -z $debian ]] || wait "$debian"

# Where Python may not keep its bytecode (containers often forbid it), every start would compile the package anew.
$environment/bin/python -m compileall -q orchestrator || true
# Loops of contact are compiled, so that nobody's first run takes longer than the next; and Python
# keeps the bytecode of what a run and its figures import. A run without contact need not wait.
# Tests call what they test, and keep it as well.
make_ready() {
    unset PYTHONDONTWRITEBYTECODE
    $environment/bin/python -c \
        'import orchestrator.run, orchestrator.results.figures.figures as f; f.warm_up()' \
        >/dev/null 2>&1 &
    nice $environment/bin/orchestrator doctor >$environment/doctor.log || cat $environment/doctor.log
    wait $! || true    # where nothing can be drawn, runs say so
    touch $environment/compiled
}

if [[ ${1:-} != tests && -w $environment ]]; then
    mapfile -t loops < <(grep -rl --include='*.py' '^@compiled' orchestrator)
    if [[ ! -e $environment/compiled || -n $(find "${loops[@]}" -newer $environment/compiled) ]]; then
        if [[ ${1:-} == run ]]; then
            echo "Compiling loops of contact, in the background"
            make_ready </dev/null >/dev/null 2>&1 &
        else
            echo "Compiling loops of contact"
            make_ready
        fi
    fi
fi
