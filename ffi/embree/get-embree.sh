#!/usr/bin/env bash
# Provides Embree 4 (headers and library) for build.rs, which searches in this order:
#   1. EMBREE_DIR   a prefix with include/embree4 and lib
#   2. the system   include/embree4/rtcore.h and libembree4.so under /usr, /usr/local or Homebrew's folder
#   3. .prefix/embree under the project's root
# On Debian 13, Ubuntu 24.04 and later this script installs the Embree 4 package of the distribution. Debian 12 has only
# Embree 3, and the library of Debian 13 requires a newer libc. There the script prepares .prefix/embree and installs
# nothing system-wide: the headers are those of Debian 13, the libraries are those in the Python wheel embreex, which are
# built for older systems. Versions and hashes are pinned below.
set -euo pipefail

deb_package=libembree-dev
deb_suite=trixie
deb_version=4.3.3+dfsg-1
deb_sha256=674a8b3d1a00612f46730da29f4cc146267b4917bbf0242113d0568429e78726
wheel=embreex==4.4.0.post1
wheel_python=312 # the libraries inside are the same for every Python version
wheel_sha256=9ee31b8b40a129620e40e06ae5c0af088b12e5f52c583e43428b87a02786d6bb

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
prefix=$root/.prefix/embree
stamp="$deb_package $deb_version $deb_sha256 $wheel $wheel_sha256 layout 1"

say() { printf 'mrvis: %s\n' "$*" >&2; }
die() {
    say "$@"
    exit 1
}

# --- 1. EMBREE_DIR --------------------------------------------------------------------------------------------------
if [[ -n ${EMBREE_DIR:-} ]]; then
    [[ -f $EMBREE_DIR/include/embree4/rtcore.h ]] ||
        die "EMBREE_DIR is $EMBREE_DIR, but include/embree4/rtcore.h is missing there: unset it or set it to the prefix of Embree 4"
    say "Embree 4: using EMBREE_DIR=$EMBREE_DIR"
    exit 0
fi

# --- 2. the system --------------------------------------------------------------------------------------------------
on_system() {
    local base lib
    for base in /usr /usr/local /opt/homebrew; do
        [[ -f $base/include/embree4/rtcore.h ]] || continue
        for lib in "$base"/lib "$base"/lib64 "$base/lib/$(uname -m)-linux-gnu"; do
            if [[ -e $lib/libembree4.so || -e $lib/libembree4.dylib ]]; then return 0; fi
        done
    done
    return 1
}
if on_system; then
    say "Embree 4: using the system's"
    exit 0
fi

# --- 3. the private prefix, if it is complete -----------------------------------------------------------------------
if [[ -f $prefix/stamp && $(<"$prefix/stamp") == "$stamp" ]]; then
    say "Embree 4: using the private prefix .prefix/embree"
    exit 0
fi

# --- installation ---------------------------------------------------------------------------------------------------
ID=unknown VERSION_ID='' VERSION_CODENAME=''
if [[ -r /etc/os-release ]]; then . /etc/os-release; fi
release=${VERSION_ID%%.*}
case $ID in
debian) packaged=$([[ -z $release || $release -ge 13 ]] && echo yes || echo no) ;; # testing and sid have no VERSION_ID
ubuntu) packaged=$([[ $release -ge 24 ]] && echo yes || echo no) ;;
*) packaged=unknown ;;
esac

case $packaged in
yes)
    "$root/.ci/debian-packages" libembree-dev
    on_system || die "libembree-dev is installed but does not contain Embree 4: set EMBREE_DIR to a prefix with include/embree4 and lib"
    say "Embree 4: using the system's"
    exit 0
    ;;
unknown)
    die "no installation of Embree 4 is known for this system ($ID): install its development package (Fedora: embree-devel," \
        "Arch and Homebrew: embree) and, if it is not under /usr, set EMBREE_DIR to the prefix that holds include/embree4"
    ;;
esac

[[ $(uname -m) == x86_64 ]] ||
    die "the private Embree 4 is built for x86_64, this machine is $(uname -m): set EMBREE_DIR to a prefix with include/embree4 and lib"
[[ $ID == debian ]] ||
    die "$ID $VERSION_ID has no Embree 4 package: set EMBREE_DIR to a prefix with include/embree4 and lib"

say "Embree 4: Debian $VERSION_ID has no Embree 4 package, preparing .prefix/embree (download of about 20 MB)"
"$root/.ci/debian-packages" python3=python3
if ! python3 -m pip --version >/dev/null 2>&1; then "$root/.ci/debian-packages" python3-pip; fi
pip_python=python3
if ! python3 -m pip --version >/dev/null 2>&1; then pip_python=/usr/bin/python3; fi # a python3 from elsewhere may lack pip

mkdir -p "$root/.prefix"
find "$root/.prefix" -maxdepth 1 -name 'part.*' -mmin +60 -exec rm -rf {} + # left by interrupted runs
work=$(mktemp -d "$root/.prefix/part.XXXXXX")
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT TERM

# Headers of Debian 13. apt itself names the archive of this machine, so that both formats of source lists work.
repository=$(apt-get indextargets --format '$(REPO_URI) $(RELEASE) $(COMPONENT)' 'Created-By: Packages' |
    awk -v codename="$VERSION_CODENAME" \
        '$3 == "main" && $1 !~ /security/ && ($2 == codename || $2 ~ /^(old)*stable$/) { print $1; exit }')
[[ -n $repository ]] || die "apt's sources contain no Debian archive (component main): add one, or set EMBREE_DIR"
keyring=/usr/share/keyrings/debian-archive-keyring.gpg
signed=
if [[ -f $keyring ]]; then signed=" signed-by=$keyring"; fi
mkdir -p "$work"/apt/{lists/partial,cache/archives/partial,parts} "$work/deb" "$work/wheel" "$work/tree"
echo "deb [arch=amd64$signed] $repository $deb_suite main" >"$work/apt/sources.list"
: >"$work/apt/status"
private_apt() {
    (cd "$work/deb" && apt-get -q \
        -o Dir::Etc::sourcelist="$work/apt/sources.list" -o Dir::Etc::sourceparts="$work/apt/parts" \
        -o Dir::Etc::preferences=/dev/null -o Dir::Etc::preferencesparts="$work/apt/parts" \
        -o Dir::State="$work/apt" -o Dir::State::Lists="$work/apt/lists" -o Dir::State::status="$work/apt/status" \
        -o Dir::Cache="$work/apt/cache" -o APT::Sandbox::User= -o APT::Default-Release= \
        -o Acquire::Languages=none -o Acquire::Retries=3 \
        -o Acquire::IndexTargets::deb::DEP-11::DefaultEnabled=false "$@" </dev/null >>"$work/log" 2>&1)
}
say "Embree 4: downloading headers, Debian package $deb_package $deb_version"
if ! private_apt update || ! private_apt download "$deb_package=$deb_version"; then
    tail -n 15 "$work/log" >&2
    die "download of $deb_package $deb_version from the Debian archive of this machine failed"
fi
deb=$(echo "$work"/deb/*.deb)
echo "$deb_sha256  $deb" | sha256sum --check --quiet >&2 || die "$deb_package $deb_version has an unexpected SHA-256 hash"
dpkg -x "$deb" "$work/deb/x"

# Libraries. pip checks the hash. The wheel tags are given, so that any Python version can download it.
say "Embree 4: downloading libraries, Python wheel $wheel"
echo "$wheel --hash=sha256:$wheel_sha256" >"$work/wheel.txt"
if ! "$pip_python" -m pip download --quiet --disable-pip-version-check --no-cache-dir --require-hashes --no-deps \
    --only-binary :all: --implementation cp --python-version "$wheel_python" --abi "cp$wheel_python" \
    --platform manylinux_2_28_x86_64 --dest "$work/wheel" -r "$work/wheel.txt" </dev/null >>"$work/log" 2>&1; then
    tail -n 15 "$work/log" >&2
    die "download of the wheel $wheel with pip failed"
fi
"$pip_python" -m zipfile -e "$work"/wheel/*.whl "$work/wheel/x"

tree=$work/tree
mkdir -p "$tree/include" "$tree/lib" "$tree/share/doc"
cp -R "$work/deb/x/usr/include/embree4" "$tree/include/embree4"
cp "$work/deb/x/usr/share/doc/$deb_package/copyright" "$tree/share/doc/copyright-embree"
cp "$work"/wheel/x/*.dist-info/licenses/LICENSE "$tree/share/doc/license-embreex" 2>/dev/null || true
# Library names in the wheel contain a hash, and the libraries refer to each other by them. Keep them; add usual names.
cp "$work"/wheel/x/embreex.libs/* "$tree/lib/"
chmod 755 "$tree"/lib/*
(
    cd "$tree/lib"
    ln -s libembree4-*.so.4 libembree4.so.4
    ln -s libembree4.so.4 libembree4.so
    ln -s libtbb-*.so.12 libtbb.so.12
)
[[ -f $tree/include/embree4/rtcore.h && -s $tree/lib/libembree4.so && -s $tree/lib/libtbb.so.12 ]] ||
    die "the downloaded files do not contain Embree 4 as expected; nothing was installed"
echo "$stamp" >"$tree/stamp"
rm -rf "$prefix"
mv "$tree" "$prefix"
say "Embree 4: ready in .prefix/embree"
