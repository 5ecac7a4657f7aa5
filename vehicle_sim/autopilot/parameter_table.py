"""The parameter table as text: name, type (f: REAL32, i: INT32), default, least, largest, unit, meaning. Alphabetical, as PX4 lists them.

Defaults that differ from PX4's generic ones are what its airframe files set too: the position and velocity gains and the attitude gains are
tuned to an x500-class vehicle. A meaning that begins with "fixed" describes the vehicle; setting it changes nothing.
"""

ROWS = """
BAT1_CAPACITY     f  5000   -1    100000  mAh    fixed: capacity of the pack
BAT1_N_CELLS      i  4      0     16      -      fixed: cells in series
BAT_CRIT_THR      f  0.07   0.05  0.5     norm   charge that is critical
BAT_EMERGEN_THR   f  0.05   0.03  0.5     norm   charge that is an emergency
BAT_LOW_THR       f  0.15   0.12  0.5     norm   charge that is low
COM_DISARM_LAND   f  2      -1    20      s      disarm this long after landing; 0 or less: never
COM_DISARM_PRFLT  f  10     -1    300     s      disarm when armed this long without take-off; 0 or less: never
COM_DL_LOSS_T     i  10     5     300     s      ground station silent this long is lost
COM_LOW_BAT_ACT   i  0      0     3       -      0 warn, 2 land when critical, 3 return when critical, land in an emergency
COM_OBL_RC_ACT    i  0      0     7       -      offboard lost: 0-2 sticks, 3 Return, 4 Land, 5 Hold, 6 terminate, 7 disarm
COM_OF_LOSS_T     f  1      0     60      s      set-points missing this long are lost
COM_RCL_EXCEPT    i  0      0     31      -      modes in which lost sticks do not matter: 1 Mission, 2 Hold, 4 Offboard
COM_RC_IN_MODE    i  3      0     4       -      sticks: 0 radio only, 1 joystick, 2 both, 3 first, 4 none
COM_RC_LOSS_T     f  0.5    0     35      s      sticks missing this long are lost
COM_RC_OVERRIDE   i  1      0     3       -      moved sticks take over: 1 in auto modes, 2 in Offboard
COM_RC_STICK_OV   f  30     5     80      %      stick deflection that takes over
COM_SPOOLUP_TIME  f  1      0     30      s      idling after arming
EKF2_NOAID_TOUT   i  5000000 500000 10000000 us dead reckoning without GPS longer than this: no position
GF_ACTION         i  2      0     5       -      geofence: 0 none, 1 warn, 2 Hold, 3 Return, 4 terminate, 5 Land
GF_MAX_HOR_DIST   f  0      0     10000   m      farthest from home; 0: no limit
GF_MAX_VER_DIST   f  0      0     10000   m      highest above home; 0: no limit
LNDMC_TRIG_TIME   f  1      0.1   10      s      stillness that counts as landed
LNDMC_XY_VEL_MAX  f  1.5    0     10      m/s    horizontal speed below which it may have landed
LNDMC_Z_VEL_MAX   f  0.25   0     5       m/s    vertical speed below which it may have landed
MAV_COMP_ID       i  1      1     250     -      fixed: component id
MAV_SYS_ID        i  1      1     255     -      fixed: system id
MAV_TYPE          i  2      0     22      -      fixed: quadrotor
MC_ACRO_P_MAX     f  100    0     1800    deg/s  Acro: pitch rate of full stick
MC_ACRO_R_MAX     f  100    0     1800    deg/s  Acro: roll rate of full stick
MC_ACRO_Y_MAX     f  100    0     1800    deg/s  Acro: yaw rate of full stick
MC_PITCHRATE_D    f  0.003  0     0.1     -      pitch rate derivative
MC_PITCHRATE_FF   f  0      0     1       -      pitch rate feed-forward
MC_PITCHRATE_I    f  0.2    0     2       -      pitch rate integral
MC_PITCHRATE_K    f  1      0.01  5       -      factor of P, I and D, pitch rate
MC_PITCHRATE_MAX  f  220    0     1800    deg/s  largest pitch rate asked for
MC_PITCHRATE_P    f  0.15   0.01  0.6     -      pitch rate to torque
MC_PITCH_P        f  9      0     12      1/s    pitch to pitch rate
MC_PR_INT_LIM     f  0.3    0     1       -      limit of the pitch rate integral
MC_ROLLRATE_D     f  0.003  0     0.1     -      roll rate derivative
MC_ROLLRATE_FF    f  0      0     1       -      roll rate feed-forward
MC_ROLLRATE_I     f  0.2    0     2       -      roll rate integral
MC_ROLLRATE_K     f  1      0.01  5       -      factor of P, I and D, roll rate
MC_ROLLRATE_MAX   f  220    0     1800    deg/s  largest roll rate asked for
MC_ROLLRATE_P     f  0.15   0.01  0.5     -      roll rate to torque
MC_ROLL_P         f  9      0     12      1/s    roll to roll rate
MC_RR_INT_LIM     f  0.3    0     1       -      limit of the roll rate integral
MC_YAWRATE_D      f  0      0     0.1     -      yaw rate derivative
MC_YAWRATE_FF     f  0      0     1       -      yaw rate feed-forward
MC_YAWRATE_I      f  0.1    0     2       -      yaw rate integral
MC_YAWRATE_K      f  1      0     5       -      factor of P, I and D, yaw rate
MC_YAWRATE_MAX    f  200    0     1800    deg/s  largest yaw rate asked for
MC_YAWRATE_P      f  0.4    0     0.6     -      yaw rate to torque
MC_YAW_P          f  2      0     5       1/s    yaw to yaw rate
MC_YAW_WEIGHT     f  0.4    0     1       -      heading against tilt in the attitude loop
MC_YR_INT_LIM     f  0.3    0     1       -      limit of the yaw rate integral
MIS_TAKEOFF_ALT   f  2.5    0     80      m      least height of a take-off
MPC_ACC_DOWN_MAX  f  3      2     15      m/s^2  acceleration downwards in auto modes
MPC_ACC_HOR       f  3      2     15      m/s^2  horizontal acceleration in auto and stick modes
MPC_ACC_UP_MAX    f  4      2     15      m/s^2  acceleration upwards in auto modes
MPC_LAND_ALT1     f  10     0     122     m      above this height landing sinks at MPC_Z_V_AUTO_DN
MPC_LAND_ALT2     f  5      0     122     m      below this height landing sinks at MPC_LAND_SPEED
MPC_LAND_SPEED    f  0.7    0.6   5       m/s    sink speed near the ground
MPC_MAN_Y_MAX     f  150    0     400     deg/s  yaw rate of full stick
MPC_THR_HOVER     f  0.5    0.1   0.8     norm   hover thrust; set from the airframe at boot
MPC_THR_MAX       f  1      0     1       norm   largest thrust
MPC_THR_MIN       f  0.06   0.01  0.5     norm   least thrust in flight
MPC_THR_XY_MARG   f  0.3    0     0.5     norm   thrust kept for horizontal control
MPC_TILTMAX_AIR   f  45     20    89      deg    largest tilt in flight
MPC_TILTMAX_LND   f  12     10    89      deg    largest tilt on the ground and in the take-off ramp
MPC_TKO_RAMP_T    f  1      0     5       s      time in which take-off thrust grows
MPC_TKO_SPEED     f  1.5    1     5       m/s    climb speed of a take-off
MPC_VEL_MANUAL    f  10     3     20      m/s    speed of full stick
MPC_XY_CRUISE     f  5      3     20      m/s    horizontal speed in auto modes
MPC_XY_P          f  1.8    0     2       1/s    position to velocity, horizontal
MPC_XY_VEL_D_ACC  f  0.2    0.1   2       -      velocity derivative, horizontal
MPC_XY_VEL_I_ACC  f  2      0     60      -      velocity integral, horizontal
MPC_XY_VEL_MAX    f  12     0     20      m/s    largest horizontal speed asked for
MPC_XY_VEL_P_ACC  f  4      1.2   5       -      velocity to acceleration, horizontal
MPC_Z_P           f  1.5    0.1   1.5     1/s    position to velocity, vertical
MPC_Z_VEL_D_ACC   f  0      0     2       -      velocity derivative, vertical
MPC_Z_VEL_I_ACC   f  2      0.2   3       -      velocity integral, vertical
MPC_Z_VEL_MAX_DN  f  1.5    0.5   4       m/s    largest sink speed asked for
MPC_Z_VEL_MAX_UP  f  3      0.5   8       m/s    largest climb speed asked for
MPC_Z_VEL_P_ACC   f  5      2     15      -      velocity to acceleration, vertical
MPC_Z_V_AUTO_DN   f  1.5    0.5   4       m/s    sink speed in auto modes
MPC_Z_V_AUTO_UP   f  3      0.5   8       m/s    climb speed in auto modes
NAV_ACC_RAD       f  2      0.05  200     m      a waypoint is reached within this distance
NAV_DLL_ACT       i  0      0     6       -      ground station lost: 0 none, 1 Hold, 2 Return, 3 Land, 5 terminate, 6 disarm
NAV_MC_ALT_RAD    f  0.8    0.05  200     m      and within this height
NAV_RCL_ACT       i  2      1     6       -      sticks lost: 1 Hold, 2 Return, 3 Land, 5 terminate, 6 disarm
RTL_DESCEND_ALT   f  30     0     100     m      Return sinks to this height above home, then lands
RTL_LAND_DELAY    f  0      -1    600     s      wait there before landing; -1: stay
RTL_MIN_DIST      f  10     0.5   100     m      nearer than this Return climbs to RTL_DESCEND_ALT only
RTL_RETURN_ALT    f  30     0     150     m      height above home of Return
SYS_AUTOSTART     i  4001   0     9999999   -      fixed: airframe number
SYS_FAILURE_EN    i  0      0     1       -      1: MAV_CMD_INJECT_FAILURE is obeyed
SYS_HITL          i  2      -1    2       -      fixed: simulation in hardware off
"""
