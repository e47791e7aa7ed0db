#!/bin/sh
# From nothing to a walk: makes a plant of more than a million triangles, builds a store through Ray, verifies it, renders
# a tour, and leaves demo/report.html with the pictures, the plots and the numbers. A second run skips what is done.
set -eu
cd "$(dirname "$0")/.."
sh deploy/setup.sh
PATH="$PWD/.venv/bin:$PATH"
export PATH

mkdir -p demo
# What the demo's pictures depend on beside its own steps: the installed code.
code=$(cat deploy/demo.sh deploy/constraints.txt $(find jobs storage player -name '*.py' | sort) | cksum)

# once NAME RESULT COMMAND...: runs a step unless it, and all before it, were done by the same code and the result is there.
again=no
once() {
    name=$1
    result=$2
    shift 2
    if [ $again = no ] && [ -e "$result" ] && [ -f "demo/.$name" ] && [ "$(cat "demo/.$name")" = "$code" ]; then
        echo "demo: $name is done"
        return 0
    fi
    again=yes
    echo "demo: $name"
    # No code's, but still there: it says that the result is the demo's own.
    if [ -f "demo/.$name" ]; then echo begun >"demo/.$name"; fi
    "$@"
    echo "$code" >"demo/.$name"
}

once scene demo/plant.glb vlod demo-scene plant demo/plant.glb --triangles 1100000 --seed 1
# `vlod build` goes on from an older store, but leaves one that it cannot read alone: it may be precious. The demo's own,
# known by the step's stamp, is made anew.
if [ -f demo/.build ] && [ -e demo/plant.store/manifest.json ] && ! vlod info demo/plant.store >/dev/null 2>&1; then
    echo "demo: demo/plant.store is of another format or damaged, and made anew"
    rm -rf demo/plant.store demo/.build
fi
once build demo/build.json vlod build demo/plant.glb demo/plant.store --executor ray \
    --region 6 1.2 -29 22 2.2 -17 --cell-size 1.3 --triangles-per-cell 40000 --report demo/build.json
once verify demo/verify.json sh -c 'vlod verify demo/plant.store --cells 40 --samples 3000 --json >demo/verify.json'
once tour demo/tour.json vlod path demo/plant.store --output demo/tour.json --frames 144
for strategy in frustum none; do
    once "play-$strategy" "demo/play-$strategy.json" \
        vlod play demo/plant.store --headless --path demo/tour.json --strategy "$strategy" --report "demo/play-$strategy.json"
done
once play demo/play.json vlod play demo/plant.store --headless --path demo/tour.json --strategy vlod \
    --frames demo/frames --report demo/play.json --compare none
once report demo/report.html vlod report demo

echo "demo: open demo/report.html"
