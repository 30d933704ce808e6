#!/bin/sh
# Stands in for the program in the fleet's tests: a sim and a policy host that speak the control plane and do nothing.
# The file `script` beside it says how each one behaves: lines "<sim|policy-host> <birth> <behaviour>", where birth * is
# every birth that has no line of its own. Births are noted in the file `births`, what sims are told in `heard`.
here=$(dirname "$0")
part=$1
touch "$here/births"
birth=$(grep -c "^$part" "$here/births")
echo "$part" >>"$here/births"
behaviour=$(sed -n "s/^$part $birth //p" "$here/script")
: "${behaviour:=$(sed -n "s/^$part \* //p" "$here/script")}"

finish() {
    id=${1#*'"id":'}
    id=${id%%[,\}]*}
    echo '{"finished":{"id":'"$id"',"steps":9,"success_once":true,"success_at_end":true,"first_success_step":4,"failed_predicate":null,"fingerprint":1,"ledger":{"physics_s":0.0,"render_s":0.0,"policy_s":0.0,"wait_s":0.0},"error":null}}'
}

echo "${behaviour:-work}" >&2
[ "$behaviour" = mute ] && exec sleep 60
[ "$behaviour" = crash ] && exit 7

if [ "$part" = policy-host ]; then
    echo '{"Ready":{"load_ms":1.0}}'
    if [ "$behaviour" = leave ]; then
        # Not before the sim is at work.
        while [ ! -e "$here/heard" ]; do sleep 0.05; done
        exit 0
    fi
    # Leaves when its stdin closes.
    cat >/dev/null
    exit 0
fi

if [ "$behaviour" = blind ]; then
    echo '{"renderer_failed":{"message":"failed to draw on x: it was lost"}}'
    exit 3
fi
renderer=none
[ "$behaviour" = other ] && renderer=other
echo '{"ready":{"shm_bytes":5,"renderer":"'"$renderer"'","identity":"'"$renderer"'"}}'
n=0
while read -r line; do
    echo "$line" >>"$here/heard"
    case "$line" in
    '{"host_up"'*)
        [ "$behaviour" = fail ] && echo '{"lane_failed":{"lane":0,"message":"policy `p` has not answered"}}'
        ;;
    '{"run"'*)
        n=$((n + 1))
        case "$behaviour" in
        "die "*) [ "$n" -gt "${behaviour#die }" ] && kill -9 $$ ;;
        hang) exec sleep 60 ;;
        idle | fail) continue ;;
        esac
        finish "$line"
        ;;
    esac
done
echo '{"progress":{"env_steps":'"$((9 * n))"',"images":0,"queries":0,"stepping_s":1.0,"working_s":1.0,"physics_s":0.0,"render_s":0.0,"idle_s":0.0}}'
