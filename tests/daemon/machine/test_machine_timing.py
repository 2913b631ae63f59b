"""`gaitd doctor` on machines that are not this one: files of their kernels, as they were read."""

import pytest

from daemon.system.machine import timing
from daemon.system.machine.finding import Grade

BOARD = {
    "proc/version": "Linux version 6.1.0-21-rt-arm64 (debian-kernel) #1 SMP PREEMPT_RT Debian",
    "proc/sys/kernel/osrelease": "6.1.0-21-rt-arm64",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
    "sys/kernel/realtime": "1",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "arch_sys_counter",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor": "performance",
    "sys/devices/system/cpu/cpu0/cpuidle/state0/name": "WFI",
    "sys/devices/system/cpu/cpu0/cpuidle/state0/latency": "1",
    "sys/devices/system/cpu/cpu0/cpuidle/state0/disable": "0",
    "sys/devices/system/cpu/isolated": "3",
    "proc/swaps": "Filename\tType\tSize\tUsed\tPriority",
    "sys/class/rtc/rtc0/name": "rtc-ds3231",
    "etc/systemd/system/gaitd-core.service": ("[Service]\nLimitRTPRIO=60\nLimitMEMLOCK=infinity\n"),
}
LAPTOP = {
    "proc/version": "Linux version 6.8.0-45-generic (buildd) #45-Ubuntu SMP PREEMPT_DYNAMIC",
    "proc/cmdline": "BOOT_IMAGE=/vmlinuz root=/dev/sda1 ro quiet splash",
    "proc/sys/kernel/osrelease": "6.8.0-45-generic",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
    "sys/devices/system/clocksource/clocksource0/current_clocksource": "hpet",
    "sys/devices/system/clocksource/clocksource0/available_clocksource": "hpet acpi_pm",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "powersave",
    "sys/devices/system/cpu/cpu0/cpuidle/state1/name": "C1E",
    "sys/devices/system/cpu/cpu0/cpuidle/state1/latency": "2",
    "sys/devices/system/cpu/cpu0/cpuidle/state1/disable": "0",
    "sys/devices/system/cpu/cpu0/cpuidle/state3/name": "C10",
    "sys/devices/system/cpu/cpu0/cpuidle/state3/latency": "890",
    "sys/devices/system/cpu/cpu0/cpuidle/state3/disable": "0",
    "proc/swaps": "Filename Type Size Used Priority\n/swapfile file 2097148 0 -2",
    "lib/systemd/system/gaitd-core.service": "[Service]\nLimitMEMLOCK=64M\n",
    "run/systemd/timesync/synchronized": "",
}
CONTAINER = {
    "proc/version": "Linux version 5.15.0 #1 SMP",
    "proc/sys/kernel/osrelease": "5.15.0",
    "proc/swaps": "Filename Type Size Used Priority\n/dev/zram0 partition 100 0 5",
}
CHECKS = (
    timing.kernel,
    timing.throttling,
    timing.unit_limits,
    timing.clock_source,
    timing.time_of_day,
    timing.governor,
    timing.idle_states,
    timing.isolated_cores,
    timing.swap,
)


def put(root, files):
    for path, text in files.items():
        file = root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text + "\n")
    return root


def looked_at(root):
    return {finding.subject: finding for finding in (check(root) for check in CHECKS)}


def limited(found):
    return {subject for subject, one in found.items() if one.grade is Grade.LIMITED}


def test_a_real_time_board_lacks_nothing(tmp_path):
    found = looked_at(put(tmp_path, BOARD))

    assert {one.grade for one in found.values()} == {Grade.GOOD}
    assert found["kernel"].found == "6.1.0-21-rt-arm64, PREEMPT_RT"
    assert found["isolated processors"].found == "3, for realtime_cpus"


def test_a_laptop_is_told_each_lack_with_what_to_do(tmp_path):
    found = looked_at(put(tmp_path, LAPTOP))

    assert limited(found) == {
        *("kernel", "limits of the unit", "clock source", "CPU governor", "idle states", "swap"),
    }
    assert found["kernel"].found == "6.8.0-45-generic, PREEMPT_DYNAMIC, preempt=its default"
    assert found["kernel"].remedy.endswith("until then boot with preempt=full")
    assert "LimitRTPRIO=50 LimitMEMLOCK=256M" in found["limits of the unit"].remedy
    assert found["idle states"].found == "down to C10, 890 µs to wake up"
    assert "/swapfile" in found["swap"].found
    assert all(found[subject].remedy for subject in limited(found))


def test_a_container_does_not_know_and_does_not_claim_to(tmp_path):
    found = looked_at(put(tmp_path, CONTAINER))

    assert found["clock source"].grade is Grade.MISSING
    assert found["limits of the unit"].grade is Grade.MISSING
    assert found["swap"].grade is Grade.GOOD
    assert limited(found) == {"kernel", "time of day"}
    assert "add a clock with a battery" in found["time of day"].remedy


def test_full_preemption_is_told_and_is_still_no_real_time_kernel(tmp_path):
    finding = timing.kernel(put(tmp_path, {**LAPTOP, "proc/cmdline": "quiet preempt=full"}))

    assert finding.grade is Grade.LIMITED
    assert "preempt=full" in finding.found
    assert "boot with" not in finding.remedy


@pytest.mark.parametrize(("runtime", "found"), [("0", "no real-time at all"), ("-1", "off")])
def test_throttling_that_is_off_or_all_is_pointed_out(tmp_path, runtime, found):
    put(tmp_path, {"proc/sys/kernel/sched_rt_runtime_us": runtime})

    finding = timing.throttling(tmp_path)

    assert finding.grade is Grade.LIMITED
    assert finding.found == found


def test_a_drop_in_has_the_last_word_on_a_limit(tmp_path):
    put(tmp_path, LAPTOP)
    folder = "etc/systemd/system/gaitd-core.service.d"
    put(tmp_path, {f"{folder}/more.conf": "[Service]\nLimitRTPRIO=70\nLimitMEMLOCK=1G:2G"})

    assert timing.unit_limits(tmp_path).grade is Grade.GOOD


def test_an_idle_state_that_is_switched_off_does_not_count(tmp_path):
    put(tmp_path, {**LAPTOP, "sys/devices/system/cpu/cpu0/cpuidle/state3/disable": "1"})

    assert timing.idle_states(tmp_path).grade is Grade.GOOD


@pytest.mark.parametrize(("resolution_ns", "grade"), [(1, Grade.GOOD), (4_000_000, Grade.LIMITED)])
def test_timers_that_end_with_a_tick_are_pointed_out(resolution_ns, grade):
    assert timing.timers(resolution_ns).grade is grade
