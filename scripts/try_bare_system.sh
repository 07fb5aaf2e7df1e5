#!/usr/bin/env bash
# Try the README's commands where nothing is installed: `sudo scripts/try_bare_system.sh`.
#
# Makes a minimal Debian in a temporary folder, with Python, pip, make and certificates, clones the
# commit at HEAD into it, and runs there, in namespaces of its own for mounts and processes:
#   make demo ARGS=--headless
#   make test
# and says how long each took. It ends at the first failure; all is removed at the end.
#
#   --user         run them as a user who may install nothing in the system
#   --demo         the demo alone
#   --args ARGS    what `make test` is given, such as "--no-skips"
#   --mirror URL   of Debian; the machine's own otherwise, as apt knows it
#   --suite NAME   of Debian; bookworm otherwise
#
# Needs root, debootstrap and git. How apt and pip reach their packages is taken from this machine.
set -euo pipefail

PACKAGES=python3,python3-pip,make,ca-certificates
CERTIFICATES=/etc/ssl/certs/ca-certificates.crt
PIP_SETTINGS=(index-url proxy cert timeout)
CHECKOUT=$(cd "$(dirname "$0")/.." && pwd)

main() {
  local mirror="" suite=bookworm user=root commands=(demo test) args=""
  while (($#)); do
    case $1 in
      --user) user=somebody ;;
      --demo) commands=(demo) ;;
      --args) args=$2; shift ;;
      --mirror) mirror=$2; shift ;;
      --suite) suite=$2; shift ;;
      *) echo "unknown option $1; the head of $0 lists them" >&2; exit 2 ;;
    esac
    shift
  done
  root=$(mktemp -d)
  trap 'rm -rf --one-file-system "$root"' EXIT
  chmod 755 "$root"
  make_system "$root" "$suite" "${mirror:-$(mirror_of_apt)}"
  useradd --root "$root" --create-home somebody
  git clone --quiet "$CHECKOUT" "$root/srv/baxter-kin"
  chroot "$root" chown -R "$user" /srv/baxter-kin
  for command in "${commands[@]}"; do
    echo "== make $command, as $user"
    local began=$SECONDS
    case $command in
      demo) inside "$root" "$user" make demo ARGS=--headless ;;
      test) inside "$root" "$user" make test ARGS="$args" ;;
    esac
    echo "== make $command took $((SECONDS - began)) s"
  done
}

make_system() {
  local root=$1 suite=$2 mirror=$3
  echo "== a minimal Debian ($suite)"
  local script=/usr/share/debootstrap/scripts/$suite
  [[ -e $script ]] || script=sid  # a release newer than this debootstrap
  debootstrap --variant=minbase --include=$PACKAGES "$suite" "$root" "$mirror" "$script" \
    >"$root.log" ||
    { tail "$root.log"; exit 1; }
  rm "$root.log"
  apt-config dump --format '%f "%v";%n' Acquire >"$root/etc/apt/apt.conf.d/90host"
  cp $CERTIFICATES "$root$CERTIFICATES"
  cp /etc/resolv.conf /etc/hosts "$root/etc/"
}

mirror_of_apt() {
  apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Origin: Debian' | head -1
}

# The processes of the namespace end with the first of them, and its mounts with the processes.
inside() {
  local root=$1 user=$2
  shift 2
  local settings=(HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
    LANG=C.UTF-8 HOME="$(chroot "$root" sh -c "echo ~$user")")
  for name in "${PIP_SETTINGS[@]}"; do
    if value=$(python3 -m pip config get "global.$name" 2>/dev/null); then
      variable=PIP_${name//-/_}
      settings+=("${variable^^}=$value")
    fi
  done
  unshare --mount --pid --fork --kill-child bash -euc '
    root=$1 user=$2
    shift 2
    mount -t proc proc "$root/proc"
    mount -t tmpfs tmpfs "$root/dev/shm"
    cd "$root"
    exec env -i "$@"' inside "$root" "$user" "${settings[@]}" \
    chroot --userspec="$user" "$root" sh -c 'cd /srv/baxter-kin && exec "$@"' sh "$@"
}

main "$@"
