#!/usr/bin/env bash
# Opens a report of `hypogeum report` in headless Chromium, from its file, at the widths of a phone and of a desktop, and checks
# that every figure is drawn and the console is silent. Usage: check-report.sh HYPOGEUM
set -euo pipefail

hypogeum=$1
checkpoint=$(realpath "$(dirname "$0")/../checkpoints/act-all")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"

"$hypogeum" run --policy idle --policy random --policy expert --policy "act=act:$checkpoint" --tasks RaiseCube,DualArmLiftTray \
    --perturbations all --episodes 1 --execute 15 --quiet --db r.db >run.txt
printf 'task,perturbation,success_percent\nRaiseCube,None,50\nRaiseCube,MO-Color,30\n' >hardware.csv
printf 'batch_size,frames_per_second\n1,20\n10,150\n' >fps.csv
"$hypogeum" report r.db -o report --hardware hardware.csv --fps fps.csv --fps other=fps.csv 2>report.txt

figures="radar changes-single-arm waterfall-single-arm waterfall-bimanual categories time-to-success failed-predicates time
    hardware fps forest-0"
for width in 390 1280; do
    timeout 120 chromium --headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking \
        --disable-component-update --disable-sync --user-data-dir="$folder/profile-$width" --window-size="$width,900" \
        --enable-logging=stderr --dump-dom "file://$folder/report/index.html" >dom.html 2>log.txt
    for figure in $figures; do
        # Not `grep -q`, which would leave the first grep with a closed pipe.
        if ! grep -A6 "id=\"figure-$figure\"" dom.html | grep '<svg' >/dev/null; then
            echo "the report has no figure $figure at width $width" >&2
            exit 1
        fi
    done
    if grep -E 'CONSOLE|Uncaught' log.txt >&2; then
        echo "the console of the report is not silent at width $width" >&2
        exit 1
    fi
    # The script has run.
    grep -q '<body class="js">' dom.html
done
echo "the report has all $(echo $figures | wc -w) figures at both widths, and the console is silent"
