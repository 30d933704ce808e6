{# Both scripts of a sweep: `part` is "shard" in that of the array and "merge" in that of the job after it. -#}
#!/bin/bash
{% if part == "shard" %}
#SBATCH --job-name={{ name }}
#SBATCH --array=0-{{ last }}
#SBATCH --output={{ log }}
#SBATCH --requeue
#SBATCH --signal=B:USR1@120
{% else %}
#SBATCH --job-name={{ name }}-merge
#SBATCH --output={{ log }}
{% endif %}
#SBATCH --open-mode=append
{% for options in sbatch %}
#SBATCH {{ options }}
{% endfor %}

cd -- {{ folder | shell }} || exit 2
{% if part == "shard" %}

# A task runs one shard and may be preempted or killed at any time: the next one continues from the shard's file.
{{ run }} &
program=$!
out_of_time=
# Preemption and scancel. A task that is cancelled must not be requeued.
trap 'kill -TERM "$program" 2>/dev/null' TERM INT
# Two minutes before the time limit.
trap 'out_of_time=yes; kill -TERM "$program" 2>/dev/null' USR1
# A signal also ends `wait`.
while kill -0 "$program" 2>/dev/null; do wait "$program"; done
wait "$program"
status=$?
if [ "$out_of_time" ] && [ "$status" -eq 130 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt 100 ]; then
    scontrol requeue "$SLURM_JOB_ID"
fi
exit "$status"
{% else %}
exec {{ merge }}
{% endif %}
