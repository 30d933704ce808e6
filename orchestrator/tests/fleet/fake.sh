#!/bin/sh
# Replaces the program in the tests of the fleet: a sim and a policy host that speak the control protocol and do nothing.
# The file `script` next to it has lines "<sim|policy-host> <spawn> <behaviour>". Spawns count from 0; * matches every
# spawn without a line of its own. Spawns are logged to the file `spawns`, commands to sims to the file `received`.
here=$(dirname "$0")
part=$1
[ "$part" = reap ] && exit 0
touch "$here/spawns"
spawn=$(grep -c "^$part" "$here/spawns")
echo "$part" >>"$here/spawns"
behaviour=$(sed -n "s/^$part $spawn //p" "$here/script")
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
        # Wait until the sim works.
        while [ ! -e "$here/received" ]; do sleep 0.05; done
        exit 0
    fi
    # Exit when stdin closes.
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
    echo "$line" >>"$here/received"
    case "$line" in
    '{"host_up"'*)
        # Ten foreign hosts come and go.
        [ "$behaviour" = desert ] && for _ in 1 2 3 4 5 6 7 8 9 10; do echo '{"host_lost":{"lane":0}}'; done
        [ "$behaviour" = fail ] && for _ in 1 2 3; do echo '{"lane_failed":{"lane":0,"message":"policy `p` has not answered","is_final":false}}'; done
        ;;
    '{"run"'*)
        n=$((n + 1))
        case "$behaviour" in
        "die "*) [ "$n" -gt "${behaviour#die }" ] && kill -9 $$ ;;
        hang) exec sleep 60 ;;
        idle) continue ;;
        # No policy but the expert gets its episodes finished.
        fail | desert | expert) [ "${line#*'"expert"'}" = "$line" ] && continue ;;
        deaf) [ "$n" -le 2 ] && continue ;;
        esac
        finish "$line"
        if [ "$behaviour" = deaf ] && [ "$n" = 12 ]; then
            echo '{"waiting":{"held":[],"hosts":[]}}'
            echo '{"waiting":{"held":[],"hosts":[]}}'
        fi
        ;;
    esac
done
echo '{"progress":{"env_steps":'"$((9 * n))"',"images":0,"queries":0,"wall_s":1.0,"physics_s":0.0,"render_s":0.0,"device_s":0,"idle_s":0.0,"cpu_s":0.0,"latencies":{"counts":[]}}}'
