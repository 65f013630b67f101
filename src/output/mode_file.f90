!> modes.txt: one row a mode or pole, with its shape as displacements of every body frame and node.
module mode_file
  use result_columns, only: motion_columns, motion_row, result_column
  use decimal, only: number_width, write_number
  use kinds, only: wp, pi
  use mode_list, only: mode_set, undamped_mode
  use evaluation_results, only: evaluation
  use body, only: body_model
  use layer_sensors, only: slip_sensor_model
  use layer_shares, only: share_names, shares
  use mechanism, only: mechanism_model
  use sensor, only: vector_to_global
  use text, only: either, joined, to_text
  use text_file, only: result_file
  implicit none (type, external)
  private
  public :: write_modes, mode_figures

  character(*), parameter :: figures = 'number[-] mode[-] kind[-] undamped_frequency[Hz] frequency[Hz] '// &
    'damping_ratio[-] loss_factor[-] real[1/s] imag[rad/s] residual[-]'

contains

  !> Writes the whole file.
  subroutine write_modes(path, deck_name, m, ev, q, modes, frozen, failed)
    character(*), intent(in) :: path, deck_name
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: q(:)              !! (nq) the state about which the modes are [m, rad]
    type(mode_set), intent(in) :: modes
    logical, intent(in) :: frozen             !! the state does not stay: they are those of an instant
    logical, intent(out) :: failed
    type(result_file) :: file
    integer :: k
    call file%open(path)
    call file%head('modes about the present state', deck_name, m%s%title)
    if (frozen) call file%line('# of the frozen instant: the state accelerates, or its coefficients change with the turn')
    call file%line('# kind: 0 undamped mode (at E_R), 1 its vibration with damping, 2 further oscillating pole of GHM, '// &
                   '3 real pole (over-damped)')
    call file%line('# mode: of kind 1 the undamped mode from which it follows while the damping grows; of kinds 2 and 3, which '// &
                   'are listed where the modes asked for have more than half of their motion (by modal masses), the one with most')
    call file%line('# '//modes%note_undamped)
    if (len(modes%note_damped) > 0) call file%line('# '//modes%note_damped)
    call file%line('# poles real + i imag, one of each conjugate pair; damping_ratio -real/|pole|, loss_factor twice that')
    call file%line('# shapes: displacements in global axes, the largest one (angles times the scene''s size) is 1')
    call file%line('# positions: '//positions())
    if (index(shape_names(), '.slip1.re') > 0) call file%line('# slip: shear angles of cores at nodes, of the same shape')
    if (size(share_names(m)) > 0) call file%line('# layers: share of a viscoelastic layer in what all bodies store and lose by '// &
                                                 'their deformation, with the moduli at the pole')
    call file%line('# columns: '//figures//' '//shape_names()//either(' ', '', size(share_names(m)) > 0)// &
                   joined(share_names(m), ' '))
    do k = 1, modes%count
      call file%row([real(k, wp), mode_figures(modes, k), transfer(displacements(modes%x(:, k)), [0.0_wp]), &
                     shares(m, q, modes%x(:, k), modes%lambda(k))])
    end do
    call file%close()
    failed = file%failed
  contains
    !> Where body frames and nodes are, in the order of the shape's columns.
    function positions() result(text)
      character(:), allocatable :: text
      real(wp), allocatable :: x(:)
      integer :: k
      x = motion_row(m, q)
      allocate (character(number_width*size(x)) :: text)
      do k = 1, size(x)
        call write_number(x(k), text(number_width*(k - 1) + 1:number_width*k))
      end do
    end function positions

    !> Column names of the shape: those of motion.txt with .re and .im.
    function shape_names() result(text)
      character(:), allocatable :: text
      type(result_column), allocatable :: motion(:), columns(:)
      integer :: k
      motion = motion_columns(m)
      do k = 1, size(m%s%bodies)
        motion = [motion, slip_columns(m%s%bodies(k))]
      end do
      columns = [([motion(k)%part('.re'), motion(k)%part('.im')], k=1, size(motion))]
      text = joined(columns%label(), ' ')
    end function shape_names

    !> Displacements of frames (x, y, angle) and nodes (x, y) in global axes, the largest one made 1; then angles of cores at nodes.
    !> Where nodes only turn, displacements are rounding and stay as small.
    pure function displacements(x) result(d)
      complex(wp), intent(in) :: x(:)           !! (nq) unknowns of the linearisation, in body axes [m, rad]
      complex(wp), allocatable :: d(:)
      complex(wp) :: w(2), u(3)
      real(wp), allocatable :: weight(:)        ! of each displacement: the scene's size for angles [-], [m]
      real(wp) :: rho(2), now(3)
      real(wp) :: turned                        ! largest rotation of a node in its body [rad]
      real(wp) :: re(size(x)), im(size(x))      ! apart, so that sections of them need no copy
      integer :: b, i, k, j
      re = real(x, wp)
      im = aimag(x)
      allocate (d(sum(3 + 2*m%s%bodies%nn)))
      allocate (weight(size(d)), source=1.0_wp)
      do b = 1, size(m%s%bodies)
        i = m%s%qo(b) + 3
        associate (body => m%s%bodies(b))
          if (.not. body%flexible) cycle
          if (size(body%dof, 1) > 3) d = [d, cmplx(slips(body, re(i + 1:i + body%nf)), slips(body, im(i + 1:i + body%nf)), wp)]
        end associate
      end do
      turned = 0.0_wp
      j = 0
      do b = 1, size(m%s%bodies)
        i = m%s%qo(b)
        d(j + 1:j + 2) = vector_to_global(ev, b, x(i + 1:i + 2))
        d(j + 3) = x(i + 3)
        weight(j + 3) = m%s%size
        j = j + 3
        associate (body => m%s%bodies(b))
          do k = 1, body%nn
            u = cmplx(body%displacement(k, re(i + 4:i + 3 + body%nf)), body%displacement(k, im(i + 4:i + 3 + body%nf)), wp)
            turned = max(turned, abs(u(3)))
            now = body%displacement(k, q(i + 4:i + 3 + body%nf))
            rho = body%x(:, k) + now(1:2)
            w = x(i + 1:i + 2) + u(1:2) + x(i + 3)*[-rho(2), rho(1)]
            d(j + 1:j + 2) = vector_to_global(ev, b, w)
            j = j + 2
          end do
        end associate
      end do
      k = maxloc(weight*abs(d(:j)), 1)
      if (weight(k)*abs(d(k)) > sqrt(epsilon(1.0_wp))*m%s%size*turned) d = d/(weight(k)*d(k))
    end function displacements
  end subroutine write_modes

  !> Names of the angles of a body's cores at its nodes.
  function slip_columns(b) result(columns)
    type(body_model), intent(in) :: b
    type(result_column), allocatable :: columns(:)
    integer :: k, j
    allocate (columns(0))
    if (.not. b%flexible) return
    columns = [((result_column(trim(b%name)//'.'//to_text(k)//'.slip'//to_text(j), 'rad'), j=1, size(b%dof, 1) - 3), k=1, b%nn)]
  end function slip_columns

  !> These angles.
  pure function slips(b, q) result(g)
    type(body_model), intent(in) :: b
    real(wp), intent(in) :: q(:)              !! (nf) elastic coordinates [m, rad]
    real(wp) :: g((size(b%dof, 1) - 3)*b%nn)  !! [rad]
    type(slip_sensor_model) :: slip
    integer :: k, n
    n = size(b%dof, 1) - 3
    do k = 1, merge(b%nn, 0, n > 0)
      call slip%find(b, k)
      g(n*(k - 1) + 1:n*k) = slip%angles(b, q)
    end do
  end function slips

  !> Columns 2 to 10 of a row.
  pure function mode_figures(modes, k) result(x)
    type(mode_set), intent(in) :: modes
    integer, intent(in) :: k
    real(wp) :: x(9), ratio, undamped
    integer :: j
    undamped = 0.0_wp
    do j = 1, modes%count
      if (modes%kind(j) == undamped_mode .and. modes%mode(j) == modes%mode(k)) undamped = abs(modes%lambda(j)%im)/(2*pi)
    end do
    associate (s => modes%lambda(k))
      ratio = 0.0_wp
      if (abs(s) > 0.0_wp) ratio = 0.0_wp - s%re/abs(s)
      x = [real(modes%mode(k), wp), real(modes%kind(k), wp), undamped, abs(s%im)/(2*pi), ratio, 2*ratio, s%re, s%im, &
           modes%residual(k)]
    end associate
  end function mode_figures
end module mode_file
