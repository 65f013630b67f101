!> The static share of modes that a body leaves out (theory.md, section 4): its residual flexibility, K^-1 less that of its modes,
!> seen by each sensor. It is exact, and known before anything runs.
module left_out_flexibility
  use kinds, only: wp
  use acting_markers, only: acting_marker, coordinates_under_load, list_acting
  use body, only: body_model
  use body_modes, only: static_displacements
  use build_scene, only: build
  use deck_records, only: deck
  use errors, only: fault_list
  use linear_state, only: evaluate_state
  use mechanism, only: mechanism_model
  use modal_basis, only: modal_model
  use modal_reduction, only: static_loads
  use scene_model, only: scene
  use scene_run, only: run_state
  use sensor, only: harmonic_motion
  use sensors, only: read_linear_sensors, read_sensors
  use sorting, only: ascending
  use summary_text, only: summary_record
  use text, only: short_text, to_text
  implicit none (type, external)
  private
  public :: flexibility_lines

  real(wp), parameter :: noticed = 1.0e-9_wp     !! share that is rounding: the modes are as good as the mesh [-]

contains

  !> One line a body and column, the largest share first.
  subroutine flexibility_lines(run, text)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(deck) :: nodal
    type(scene) :: s
    type(fault_list) :: faults
    type(acting_marker), allocatable :: acting(:, :)
    real(wp) :: share(run%list%columns, size(run%d%bodies))   ! [-]
    integer, allocatable :: order(:)
    integer :: k, at(2)
    do k = 1, size(run%d%bodies)
      if (run%d%bodies(k)%auto_modes) call text%line('body "'//trim(run%d%bodies(k)%name)//'": modes=''auto'': the run finds '// &
                                                     'how many are enough; here it has its whole mesh')
    end do
    associate (reduced => run%d%bodies%modes > 0 .and. run%d%bodies%flexible .and. .not. run%d%bodies%auto_modes)
      if (.not. any(reduced) .or. size(share) == 0) return
      nodal = run%d
      nodal%bodies%modes = 0
      call build(nodal, s, faults)
      if (faults%count > 0) return
      acting = list_acting(nodal, s)
      share = 0.0_wp
      do k = 1, size(reduced)
        if (reduced(k)) share(:, k) = body_shares(run, k, s%bodies(k), coordinates_under_load(acting, k, s%bodies(k)))
      end do
    end associate
    call text%line('')
    call text%line('left-out modes: their share of the static response of columns (residual flexibility) to forces and')
    call text%line('moments where joints, drives, springs and loads act, and to inertia forces, each storing the same energy')
    if (all(share <= noticed)) call text%line('  none above '//short_text(noticed, 0))
    call text%open('static_share_of_left_out_modes', '[')
    order = ascending(-[share])
    do k = 1, count(share > noticed)
      at = 1 + [mod(order(k) - 1, size(share, 1)), (order(k) - 1)/size(share, 1)]
      call text%item('  body "{body='//trim(run%d%bodies(at(2))%name)//'}", '// &
                     '{column='//trim(run%list%column(at(1))%label())//'}: {share 1}', &
                     [share(at(1), at(2))])
    end do
    call text%close()
  end subroutine flexibility_lines

  !> Of each column the largest response that the modes leave out over the largest one, under loads that store the same energy.
  function body_shares(run, k, b, loaded) result(share)
    type(run_state), intent(inout) :: run
    integer, intent(in) :: k                     !! number of the body
    type(body_model), intent(in) :: b            !! the body in nodal coordinates
    integer, intent(in) :: loaded(:)             !! those on which something acts
    real(wp) :: share(run%list%columns)          !! [-]
    real(wp) :: f(b%nf, size(loaded) + 4)        ! loads [N, N m], [kg, kg m]
    real(wp) :: y(b%nf, size(loaded) + 4)        ! their static displacements [m, rad]
    real(wp), allocatable :: x(:, :)             ! modes of the reduced body by nodal coordinates [m, rad, over kg^.5 m]
    real(wp), allocatable :: whole(:, :), left(:, :)   ! (columns, loads) responses of the columns [of the column]
    real(wp) :: largest(size(share))             ! [of the column]
    integer :: c
    logical :: bad
    share = 0.0_wp
    f = static_loads(b, loaded)
    call static_displacements(b, f, y, bad)
    if (bad) return
    select type (basis => run%sys%m%s%bodies(k)%basis)
    type is (modal_model)
      x = basis%psi(1:, :)
      whole = responses(run, k, b, y)
      left = responses(run, k, b, y - matmul(x, matmul(transpose(x), f)/spread(basis%omega2, 2, size(f, 2))))
    end select
    largest = maxval(abs(whole), 2)
    do c = 1, size(share)
      associate (same => run%list%column%unit == run%list%column(c)%unit)
        if (largest(c) <= noticed*maxval(largest, same)) cycle   ! rounding
      end associate
      share(c) = maxval(abs(left(c, :)))/largest(c)
    end do
  end function body_shares

  !> Change of the columns by displacements of a body's nodes, which the body gets as its first mode.
  function responses(run, k, b, y) result(columns)
    type(run_state), intent(inout) :: run
    integer, intent(in) :: k                     !! number of the body
    type(body_model), intent(in) :: b            !! the body in nodal coordinates
    real(wp), intent(in) :: y(:, :)              !! (nf, loads) [m, rad]
    real(wp) :: columns(run%list%columns, size(y, 2))   !! [of the column]
    type(mechanism_model) :: m
    type(harmonic_motion) :: motion
    real(wp) :: values(run%list%columns)         ! [of the column]
    complex(wp) :: amplitudes(run%list%columns)  ! [of the column]
    integer :: j
    call evaluate_state(run%sys, run%sys%options, run%y)
    call read_sensors(run%list, run%sys%m, run%sys%ev, run%y, values)
    m = run%sys%m
    allocate (motion%x(m%s%nq), motion%lambda(m%s%rows), source=(0.0_wp, 0.0_wp))
    motion%x(m%s%qo(k) + 4) = 1.0_wp
    do j = 1, size(y, 2)
      select type (basis => m%s%bodies(k)%basis)
      type is (modal_model)
        basis%psi(1:, 1) = y(:, j)
      end select
      call read_linear_sensors(run%list, m, run%sys%ev, run%y, motion, amplitudes)
      columns(:, j) = merge(0.0_wp, real(amplitudes, wp), index(run%list%column%unit, 'kg^.5') > 0)
    end do
  end function responses
end module left_out_flexibility
