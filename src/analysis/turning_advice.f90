!> Which steps of generalized_alpha are stable where a joint or a drive holds a body on a line that turns (theory.md, section 7):
!> by the eigenvalues of the step's map about the scene as assembled, while it turns as a whole.
module turning_advice
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use deck_changes, only: can_change, change_body, two_modes
  use deck_records, only: deck
  use dynamic_stiffness, only: stiffness_system
  use dynamics, only: evaluate_start, marker_kinematics
  use evaluation_results, only: evaluation
  use frame_axes, only: to_body
  use generalized_alpha, only: alpha_method, chung_hulbert
  use history, only: drive_values
  use linear_matrices, only: linear_mechanism
  use linear_state, only: linear_system_with
  use mechanism, only: mechanism_model
  use scene_run, only: run_state
  use step_map, only: turning_map
  use summary, only: add_warnings
  use summary_text, only: json_number, summary_record
  use text, only: short_text, to_text
  use trial_scene, only: assemble_deck
  implicit none (type, external)
  private
  public :: advise_turning

  integer, parameter :: most = 40                !! coordinates of which a map is made
  real(wp), parameter :: small = 0.25_wp         !! angle whose sine it is to 1 % [rad]

contains

  !> Tells up to which step no small motion grows, and warns where the deck's step makes one grow in its run.
  subroutine advise_turning(run, h, text)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: h                    !! the deck's step [s]
    type(summary_record), intent(inout) :: text
    character(:), allocatable :: name, words
    type(turning_map) :: map
    real(wp) :: rate                             ! of the line [rad/s]
    real(wp) :: own, growth                      ! of motions, by themselves and with the deck's step [1/s]
    real(wp) :: bound                            ! [s]
    real(wp) :: swing                            ! of bodies about the steady turn [rad]
    logical :: turns
    associate (m => run%sys%m, nq => run%sys%m%s%nq, t => run%d%transient)
      call find_turning_line(m, run%sys%ev, run%y(1:nq), run%y(nq + 1:2*nq), t%t_end, rate, name)
      if (rate <= 0.0_wp) return
      call text%figure('    where the line of "'//name//'" turns, at ', 'line_rate', rate, 4)
      call text%words%add(' rad/s: ')
      call make_map(run, rate, map, swing, turns)
      if (.not. turns) then
        call text%line('no bound is known, since the scene does not turn as a whole: compare with radau or smaller steps')
        return
      end if
      call find_bound(map, chung_hulbert(t%spectral_radius), rate, t%t_end, h, own, growth, bound)
      call text%member('line_growth', json_number(growth))
      if (own*t%t_end > 1.0_wp) then
        call text%line('no bound is known, since motions about the start grow by themselves, at '//short_text(own, 2)// &
                       ' 1/s: compare with radau or smaller steps')
        return
      end if
      call text%figure('small motions about the start grow in this run with no step up to ', 'line_step', bound, 4)
      call text%line(' s (spectral_radius='//to_text(t%spectral_radius)//')')
      call text%member('line_swing', json_number(swing))
      if (swing > small) then
        call text%line('    but from this start bodies swing by about '//short_text(swing, 1)//' rad about the steady turn: '// &
                       'motions so large may ask for smaller steps, compare with radau')
      end if
      if (growth*t%t_end <= 1.0_wp) return
      words = 'warning: transient/step: in steps of '//to_text(h)//' s the line of "'//name//'" turns by '// &
              short_text(h*rate, 2)//' rad each, and small motions grow at '//short_text(growth, 2)//' 1/s; expected at most '// &
              short_text(bound, 2)//' s, or radau'
      call add_warnings(text, t%at%file//':'//to_text(t%at%line), words//new_line('a'))
    end associate
  end subroutine advise_turning

  !> The line on which a joint or a drive holds a body and that turns fastest: with the body that carries it at the start, or as a
  !> drive turns that body during the run.
  subroutine find_turning_line(m, ev, q, v, t_end, rate, name)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in), contiguous :: q(:), v(:)   !! (nq) assembled [m, rad] and per second
    real(wp), intent(in) :: t_end              !! [s]
    real(wp), intent(out) :: rate              !! 0: none turns [rad/s]
    character(:), allocatable, intent(out) :: name   !! of the joint or drive
    integer, parameter :: times = 1000         ! at which a drive is asked for its rate, in step with no period
    real(wp), parameter :: golden = 0.5_wp*(sqrt(5.0_wp) - 1)   ! [-]
    type(evaluation) :: work
    real(wp) :: fastest, h(0:2)
    integer :: i, j, k
    work = ev
    call marker_kinematics(m, work, q, v)
    rate = 0.0_wp
    name = ''
    do i = 1, size(m%s%constraints)
      associate (line => m%s%constraints(i)%item)
        if (.not. line%line_turns()) cycle
        fastest = abs(work%p%rate(line%ib))
        do j = m%s%joints + 1, m%s%permanent
          associate (drive => m%s%constraints(j)%item)
            if (.not. drive%angular .or. m%markers%body(drive%ia) /= m%markers%body(line%ib)) cycle
            do k = 0, times
              call drive_values(drive%target, drive%rate, drive%origin, merge(1.0_wp, modulo(k*golden, 1.0_wp), k == times)*t_end, &
                                .false., h)
              fastest = max(fastest, abs(h(1)))
            end do
          end associate
        end do
        if (fastest <= rate) cycle
        rate = fastest
        name = trim(line%name)
      end associate
    end do
  end subroutine find_turning_line

  !> The map of a step about the start, all bodies turning at one rate about the point that the joints leave at rest. Flexible
  !> bodies have two modes each where the mesh has too many coordinates.
  subroutine make_map(run, rate, map, swing, turns)
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: rate                 !! [rad/s]
    type(turning_map), intent(out) :: map
    real(wp), intent(out) :: swing               !! how far the start is from the steady turn [rad]
    logical, intent(out) :: turns                !! the scene can turn so, and has few enough coordinates
    type(deck) :: fewer
    type(mechanism_model) :: m
    type(evaluation) :: ev
    type(assembly_report) :: report
    real(wp), allocatable :: q(:)                ! [m, rad]
    integer :: b
    if (run%sys%m%s%nq <= most) then
      ev = run%sys%ev
      call map_about(run%sys%m, ev, run%y(1:run%sys%m%s%nq), rate, map, swing, turns)
      return
    end if
    fewer = run%d
    do b = 1, size(fewer%bodies)
      if (can_change(fewer, b, two_modes)) call change_body(fewer, b, two_modes)
    end do
    call assemble_deck(fewer, m, ev, q, report, turns)
    swing = 0.0_wp
    if (turns) turns = m%s%nq <= most
    if (turns) call map_about(m, ev, q, rate, map, swing, turns)
  end subroutine make_map

  !> The same of a mechanism.
  subroutine map_about(m, ev, q, rate, map, swing, turns)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:)     !! (nq) assembled [m, rad]
    real(wp), intent(in) :: rate                 !! [rad/s]
    type(turning_map), intent(out) :: map
    real(wp), intent(out) :: swing               !! angle by which a body is off the steady turn, linearised [rad]
    logical, intent(out) :: turns                !! the joints let it turn so
    real(wp), parameter :: open = 1.0e-6_wp      ! rates of rows that are rounding, over those of the scene's size [-]
    type(stiffness_system) :: ds
    type(linear_mechanism) :: lin
    complex(wp), allocatable :: away(:)          ! from the steady turn, and multipliers [m, rad; N]
    real(wp) :: rest(m%s%nq)                     ! forces that are not balanced in it [N, N m]
    real(wp) :: motion(m%s%nq, 0:2)              ! unit turn about the origin, shifts along x and y [m, rad]
    real(wp) :: rates(m%s%rows, 0:2)             ! of the rows in them [m]
    real(wp) :: v(m%s%nq), y(m%s%ny)             ! [m/s, rad/s], layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    real(wp) :: a(2, 2), centre(2), determinant  ! [m2], [m], [m4]
    integer :: b, i, k
    motion = 0.0_wp
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b)
      motion(i + 1:i + 3, 0) = [-q(i + 2), q(i + 1), 1.0_wp]
      motion(i + 1, 1) = 1.0_wp
      motion(i + 2, 2) = 1.0_wp
    end do
    y = 0.0_wp
    y(1:m%s%nq) = q
    call linear_about(motion(:, 0))
    rates = 0.0_wp
    do k = 0, 2
      call lin%jacobian%times(1.0_wp, to_body(m, ev, motion(:, k)), rates(:, k))
    end do
    do k = m%s%joints + 1, m%s%permanent         ! drives turn it
      associate (drive => m%s%constraints(k)%item)
        if (drive%angular) rates(drive%first:drive%first + drive%rows - 1, :) = 0.0_wp
      end associate
    end do
    a = matmul(transpose(rates(:, 1:2)), rates(:, 1:2))
    centre = -matmul(transpose(rates(:, 1:2)), rates(:, 0))
    do k = 1, 2                                  ! free shifts stay 0
      if (a(k, k) <= open) a(k, k) = 1.0_wp
    end do
    determinant = a(1, 1)*a(2, 2) - a(1, 2)*a(2, 1)
    if (determinant > open*a(1, 1)*a(2, 2)) then
      centre = [a(2, 2)*centre(1) - a(1, 2)*centre(2), a(1, 1)*centre(2) - a(2, 1)*centre(1)]/determinant
    else                                         ! a shift across a line is free: the solution along one axis
      k = merge(1, 2, a(1, 1) > a(2, 2))
      centre = merge(centre/a(k, k), 0.0_wp, [1, 2] == k)
    end if
    swing = 0.0_wp
    turns = all(abs(rates(:, 0) + matmul(rates(:, 1:2), centre)) <= open*m%s%size)
    if (.not. turns) return
    v = rate*(motion(:, 0) + matmul(motion(:, 1:2), centre))
    call linear_about(v)
    call map%build(lin, ds%active, m%s%qo, spread(rate, 1, size(m%s%bodies)), ev%a(m%s%qo + 3))
    do b = 1, size(m%s%bodies)                   ! what a is beyond that of the turn
      i = m%s%qo(b)
      ev%a(i + 1:i + 2) = ev%a(i + 1:i + 2) + rate*[v(i + 2), -v(i + 1)]
    end do
    rest = 0.0_wp
    call lin%mass%times(-1.0_wp, to_body(m, ev, ev%a), rest(1:m%s%nq))
    call ds%set((0.0_wp, 0.0_wp), 0.0_wp)
    call ds%factor()
    away = ds%padded(cmplx(rest, 0.0_wp, wp))
    call ds%solve(away, exists=turns)
    swing = maxval(abs(real(away(m%s%qo + 3), wp)))
    if (.not. turns) swing = 0.0_wp
    turns = .true.
  contains
    !> The linearisation about q and rates.
    subroutine linear_about(rates)
      real(wp), intent(in) :: rates(:)           !! (nq) [m/s, rad/s]
      y(m%s%nq + 1:2*m%s%nq) = rates
      call evaluate_start(m, ev, q, rates)
      call linear_system_with(m, ev, y, ev%a, ev%lambda, ev%action, ds, lin)
    end subroutine linear_about
  end subroutine map_about

  !> How fast motions grow by themselves and with the deck's step, and the step below which none grows in the run. Steps are tried
  !> down from one rad.
  subroutine find_bound(map, method, rate, t_end, h, own, growth, bound)
    type(turning_map), intent(in) :: map
    type(alpha_method), intent(in) :: method
    real(wp), intent(in) :: rate                 !! [rad/s]
    real(wp), intent(in) :: t_end                !! [s]
    real(wp), intent(in) :: h                    !! the deck's step [s]
    real(wp), intent(out) :: own, growth         !! 0: none grows [1/s]
    real(wp), intent(out) :: bound               !! [s]
    real(wp), parameter :: longest = 1.0_wp, shortest = 0.01_wp, ratio = 0.85_wp   ! of the steps tried [rad], [rad], [-]
    real(wp), parameter :: resolved = 1.0e-3_wp  ! a step so short shows what the equations do by themselves [rad]
    real(wp), parameter :: noise = 1.0e-6_wp     ! of an eigenvalue [-]
    real(wp) :: tried
    own = 0.0_wp
    own = rate_of(resolved/rate)
    growth = rate_of(h)
    bound = 0.0_wp
    if (own*t_end > 1.0_wp) return
    tried = longest/rate
    do while (tried >= shortest/rate)
      if (rate_of(tried)*t_end <= 1.0_wp) then
        bound = max(bound, tried)
      else
        bound = 0.0_wp
      end if
      tried = ratio*tried
    end do
    if (growth*t_end <= 1.0_wp) bound = max(bound, h)
  contains
    !> Rate of growth with a step, beyond that of the motions by themselves.
    real(wp) function rate_of(step)
      real(wp), intent(in) :: step               !! [s]
      real(wp) :: x
      x = map%growth(method, step)
      rate_of = 0.0_wp
      if (x > 1 + noise) rate_of = max(0.0_wp, log(x)/step - own)
    end function rate_of
  end subroutine find_bound
end module turning_advice
