# Sourced by the scripts of this folder. `packages NAME==VERSION…` makes a Python with these packages, in a temporary folder
# that is removed at the end, and sets `python`. FINDINGS_PYTHON may list interpreters (`a:b`): the first that has all of the
# versions is used as it is. `made_by VERSION…` names the versions of Python that environments can be made by, where not every
# one will do; FINDINGS_BASE names one to take.

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
made=0
versions=()

made_by() {
    versions=("$@")
}

# Sets `base`: the Python that makes environments.
find_base() {
    local version
    base=${FINDINGS_BASE:-python3}
    [[ -n ${FINDINGS_BASE:-} || ${#versions[@]} == 0 ]] && return
    for version in "${versions[@]}"; do
        for base in python3 "python$version"; do
            "$base" -c "import sys; sys.exit('%d.%d' % sys.version_info[:2] != '$version')" 2>/dev/null && return
        done
    done
    echo "none of the versions ${versions[*]} of Python is installed; set FINDINGS_BASE to one" >&2
    exit 1
}

packages() {
    local candidate candidates
    IFS=: read -ra candidates <<<"${FINDINGS_PYTHON:-}"
    for candidate in ${candidates[@]+"${candidates[@]}"}; do
        if "$candidate" - "$@" <<'PYTHON'; then
import sys
from importlib.metadata import PackageNotFoundError, version

def has(pin):
    name, _, wanted = pin.partition("==")
    try:
        return version(name.partition("[")[0]).partition("+")[0] == wanted
    except PackageNotFoundError:
        return False

sys.exit(not all(map(has, sys.argv[1:])))
PYTHON
            python=$candidate
            return
        fi
    done
    find_base
    made=$((made + 1))
    "$base" -m venv "$folder/python$made"
    python=$folder/python$made/bin/python
    "$python" -m pip install --quiet --disable-pip-version-check "$@"
}
