!> The linear system about a run's present state: evaluates the equations there, linearises, leaves dependent constraint rows
!> out.
module linear_state
  use kinds, only: wp
  use assembly_conflict, only: deck_line_of
  use assembly_reports, only: too_uneven, weakest_constraint, weakest_text
  use closed_loops, only: loop_system
  use dynamic_stiffness, only: stiffness_system
  use elastic_operators, only: add_product, mass_product
  use errors, only: failure
  use evaluation_settings, only: evaluation_options
  use force_element, only: element_action
  use force_scale, only: largest_force
  use joint_correction, only: correct_accelerations, balanced
  use joint_geometry, only: condense_geometry
  use joint_response, only: free_accelerations
  use linear_matrices, only: linear_mechanism
  use linearisation, only: linearise
  use evaluation_results, only: conditions_of, evaluation
  use mechanism, only: mechanism_model
  use mechanism_ode, only: mechanism_system
  use scene_run, only: run_state
  use summary, only: weak_frames
  implicit none (type, external)
  private
  public :: linear_system, linear_system_with, evaluate_state, refuse_uneven, at_equilibrium, largest_acceleration
  public :: elastic_rounding, on_masses

  real(wp), parameter :: cancelled = 256*epsilon(1.0_wp)    !! what sums of elastic forces leave of zero [-]
  real(wp), parameter :: rounding = sqrt(epsilon(1.0_wp))   !! accelerations that are nothing beside those without joints [-]
  real(wp), parameter :: of_each = 1.0e3_wp*epsilon(1.0_wp)   !! and beside those by each force alone, which may cancel [-]

contains

  !> Evaluates the equations at a state at t = 0. The reactions become stiffness, so
  !> that they are corrected to rounding even where uneven masses cost them only a few digits.
  subroutine evaluate_state(sys, options, y)
    type(mechanism_system), intent(inout) :: sys
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in), contiguous :: y(:)        !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    real(wp), allocatable :: dy(:)
    allocate (dy(size(y)))
    call sys%rates(options, 0.0_wp, y, dy)
    if (sys%m%s%rows == 0 .or. sys%ev%schur%singular) return
    if (.not. balanced(sys%m, sys%ev)) call correct_accelerations(sys%m, sys%ev)
  end subroutine evaluate_state

  !> Refuses a state whose reactions are lost in rounding, since they become stiffness, or, where something moves or will move,
  !> whose accelerations are.
  subroutine refuse_uneven(run, analysis, status, fail)
    type(run_state), intent(in) :: run
    character(*), intent(in) :: analysis            !! name
    integer, intent(in) :: status                   !! to end with
    type(failure), intent(inout) :: fail
    character(:), allocatable :: words
    logical :: moves
    integer :: k
    associate (ev => run%sys%ev, nq => run%sys%m%s%nq)
      moves = run%d%transient%present .or. any(abs(run%y(nq + 1:2*nq)) > 0.0_wp)
      if (fail%happened() .or. .not. (ev%schur%ill_conditioned .or. (ev%broken .and. moves))) return
      words = weak_frames(run%sys%m)
      if (len(words) == 0) words = too_uneven//weakest_text(run%sys%m, ev)//', and the reactions cannot be computed'
      call fail%raise(status, 'the '//analysis//' cannot be done: '//words)
      k = weakest_constraint(run%sys%m, ev)
      if (k > 0) fail%deck_line = deck_line_of(run%d, k)
    end associate
  end subroutine refuse_uneven

  !> Whether the evaluated state is an equilibrium at rest.
  pure logical function at_equilibrium(run) result(yes)
    type(run_state), intent(in) :: run
    associate (ev => run%sys%ev, nq => run%sys%m%s%nq)
      yes = .not. any(abs(run%y(nq + 1:2*nq)) > 0.0_wp)
      if (yes .and. maxval(abs(ev%a)) > least_acceleration(run)) yes = sqrt(on_masses(run, ev%a)) <= elastic_rounding(run)
    end associate
  end function at_equilibrium

  !> The square of accelerations, weighed by the masses as rates are in twice the kinetic energy.
  pure real(wp) function on_masses(run, x) result(total)   ! [N2/kg]
    type(run_state), intent(in) :: run
    real(wp), intent(in) :: x(:)                    !! (nq) [m/s2, rad/s2]
    real(wp) :: force(maxval(run%sys%m%s%bodies%nf))   ! [N, N m]
    real(wp) :: a(2)                                ! [m/s2]
    integer :: b
    total = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      associate (body => run%sys%m%s%bodies(b), i => run%sys%m%s%qo(b))
        a = run%sys%ev%frame%to_body(b, x(i + 1:i + 2))
        total = total + body%mass*dot_product(a, a) + body%i11*x(i + 3)**2 + 2*x(i + 3)*(body%i1(1)*a(2) - body%i1(2)*a(1))
        if (.not. body%flexible) cycle
        associate (xf => x(i + 4:i + 3 + body%nf), f => force(:body%nf))
          call mass_product(body%op, xf, f)
          total = total + dot_product(xf, f + 2*matmul(body%shape%sbar, a) + 2*x(i + 3)*body%shape%c0)
        end associate
      end associate
    end do
    total = max(total, 0.0_wp)
  end function on_masses

  !> What rounding leaves of elastic forces, weighed likewise, its root.
  pure real(wp) function elastic_rounding(run) result(noise)   ! [N/kg^.5]
    type(run_state), intent(in) :: run
    real(wp) :: force(maxval(run%sys%m%s%bodies%nf))   ! [N, N m]
    integer :: b, k
    noise = 0.0_wp
    do b = 1, size(run%sys%m%s%bodies)
      associate (body => run%sys%m%s%bodies(b), i => run%sys%m%s%qo(b))
        if (.not. body%flexible) cycle
        associate (op => body%op, q => run%y(i + 4:i + 3 + body%nf), f => force(:body%nf))
          f = 0.0_wp
          call add_product(op%symmetric, abs(op%k), abs(q), f)
          do k = 1, body%nf
            noise = noise + f(k)**2/(op%m(op%symmetric%entry(k, k)) + op%j(op%symmetric%entry(k, k)))
          end do
        end associate
      end associate
    end do
    noise = cancelled*sqrt(noise)
  end function elastic_rounding

  !> Gravity, or what frames would do without joints.
  pure real(wp) function largest_acceleration(run) result(a)
    type(run_state), intent(in) :: run
    a = max(norm2(run%sys%ev%options%gravity), maxval(abs(run%sys%ev%frame%free)))   ! [m/s2, rad/s2]
  end function largest_acceleration

  !> Accelerations that are rounding: of what acts on frames together, or of forces that cancel, between each other or, of a
  !> controller, what it senses and what that is to be.
  pure real(wp) function least_acceleration(run) result(a)
    type(run_state), intent(in) :: run
    real(wp), dimension(3, size(run%sys%m%s%bodies)) :: sizes, alone   ! of wrenches [N, N m], [m/s2, rad/s2]
    integer :: k
    a = rounding*largest_acceleration(run)             ! [m/s2, rad/s2]
    sizes = 0.0_wp
    associate (m => run%sys%m, ev => run%sys%ev)
      do k = 1, m%s%acting
        associate (f => m%s%forces(k)%item, x => ev%action(k))
          call add_size(f%ia, abs(x%a), sizes)
          if (f%ib /= f%ia) call add_size(f%ib, abs(x%b), sizes)
          if (f%controller == 0) cycle
          call add_size(f%ia, ev%control(f%controller)%parts*abs(f%unit_wrench(ev%p, conditions_of(m, ev, k))), sizes)
        end associate
      end do
      call free_accelerations(size(m%s%bodies), sizes, -abs(ev%frame%l), ev%frame%dinv, alone)
    end associate
    a = max(a, of_each*maxval([0.0_wp, alone]))
  contains
    !> Adds a wrench on a marker to those of its body.
    pure subroutine add_size(marker, w, sizes)
      integer, intent(in) :: marker
      real(wp), intent(in) :: w(3)                    !! [N, N, N m]
      real(wp), intent(inout) :: sizes(:, :)          !! (3, bodies) [N, N, N m]
      associate (b => run%sys%m%s%markers(marker)%body, rho => run%sys%ev%p%rho(:, marker))
        if (b > 0) sizes(:, b) = sizes(:, b) + [norm2(w(1:2)), norm2(w(1:2)), w(3) + norm2(rho)*norm2(w(1:2))]
      end associate
    end subroutine add_size
  end function least_acceleration

  !> The dynamic stiffness about the present state. Accelerations that are rounding are set to 0 (all of an equilibrium; angular
  !> ones of a body that falls): they would make the stiffness unsymmetric, and slow motions of rigid ones.
  subroutine linear_system(run, ds, loops)
    type(run_state), intent(inout) :: run
    type(stiffness_system), intent(out) :: ds
    type(loop_system), intent(out), optional :: loops   !! of controllers, which ds can then close
    type(linear_mechanism) :: lin
    real(wp) :: a(run%sys%m%s%nq)                   ! [m/s2, rad/s2]
    call evaluate_state(run%sys, run%sys%options, run%y)
    a = 0.0_wp
    associate (m => run%sys%m, ev => run%sys%ev)
      if (.not. at_equilibrium(run)) a = merge(ev%a, 0.0_wp, abs(ev%a) > least_acceleration(run))
      if (present(loops)) call loops%build(m, ev, run%y(m%s%nq + 1:2*m%s%nq))
      call linear_system_with(m, ev, run%y, a, ev%lambda, ev%action, ds, lin, loops)
    end associate
  end subroutine linear_system

  !> The linearisation about an evaluated state with given accelerations, multipliers and forces, and its dynamic stiffness.
  subroutine linear_system_with(m, ev, y, a, lambda, action, ds, lin, loops)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: y(:)        !! (ny) layout in `scene_model` [m, rad], [m/s, rad/s], [J]
    real(wp), intent(in), contiguous :: a(:)        !! (nq) [m/s2, rad/s2]
    real(wp), intent(in), contiguous :: lambda(:)   !! (rows) [N]
    type(element_action), intent(in) :: action(:)   !! (force elements)
    type(stiffness_system), intent(out) :: ds
    type(linear_mechanism), intent(out) :: lin
    type(loop_system), intent(in), optional :: loops   !! that the dynamic stiffness is to close
    logical, allocatable :: dependent(:)
    call linearise(m, ev, y(1:m%s%nq), y(m%s%nq + 1:2*m%s%nq), a, lambda, action, lin)
    if (present(loops)) call loops%couple(lin)
    allocate (dependent(lin%rows))
    if (lin%rows > 0) then
      call condense_geometry(m, ev)
      call ev%schur%weak_rows(dependent)
    end if
    call ds%build(m, lin, largest_force(m, ev), dependent)
  end subroutine linear_system_with
end module linear_state
