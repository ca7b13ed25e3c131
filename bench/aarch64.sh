#!/bin/sh
# Python with this tree on an emulated ARM CPU. On Debian:
#
#     apt-get install qemu-user-static
#     bench/aarch64.sh FOLDER -m bench bits
#
# The first call puts Debian's Python for arm64 and wheels for it into FOLDER and needs no rights.
# FOLDER/python is then an interpreter. Ubuntu needs a source of arm64 packages for apt.
set -eu
[ $# -gt 0 ] || { sed -n '2,8s/^# \{0,1\}//p' "$0"; exit 3; }
tree=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$1"
folder=$(cd "$1" && pwd)
shift
root=$folder/root

fetch_python() { # with the libraries it needs, for a system that has nothing installed
    mkdir -p "$folder/apt/lists/partial" "$folder/apt/archives/partial"
    set -- -q -o APT::Architecture=arm64 -o APT::Architectures=arm64 -o Dir::State="$folder/apt" \
        -o Dir::State::status=/dev/null -o Dir::Cache="$folder/apt" -o Debug::NoLocking=1 \
        -o APT::Sandbox::User="$(id -un)"
    apt-get "$@" update
    apt-get "$@" --yes --download-only --no-install-recommends install python3 libstdc++6
    for package in "$folder"/apt/archives/*.deb; do dpkg-deb -x "$package" "$root"; done
}

fetch_wheels() { # of rigidmc's own needs and of its quick tests
    set -- --target "$root/usr/lib/python3/dist-packages" --only-binary=:all: --python-version "$1"
    for glibc in 17 27 28 31 34; do set -- "$@" --platform "manylinux_2_${glibc}_aarch64"; done
    "${PYTHON:-python3}" -m pip install -q "$@" --platform manylinux2014_aarch64 \
        "$tree" pytest pytest-xdist hypothesis mpmath
    rm -r "$root"/usr/lib/python3/dist-packages/rigidmc # the tree is used instead
    echo "$tree" > "$root/usr/lib/python3/dist-packages/tree.pth"
}

if [ ! -x "$folder/python" ]; then
    fetch_python
    python=$(cd "$root/usr/bin" && ls -d python3.?? | tail -n 1)
    fetch_wheels "${python#python}"
    # The kernel need not know ARM programs: Python starts others of its kind through this script.
    cat > "$folder/python.new" <<EOF
#!/bin/sh
exec qemu-aarch64-static -L "$root" -0 "\$0" "$root/usr/bin/$python" "\$@"
EOF
    chmod +x "$folder/python.new"
    mv "$folder/python.new" "$folder/python"
fi
exec "$folder/python" "$@"
