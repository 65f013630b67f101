!> Bodies on their joints, what else these join at rest: by few modes and static shapes, for questions about their stiffness.
module held_body
  use kinds, only: half_digits, wp
  use body, only: body_model
  use elastic_operators, only: mass_product
  use lapack, only: dgeqp3, dorgqr, dsygvd
  use mechanism, only: mechanism_model
  use modal_basis, only: modal_model
  use modal_reduction, only: reduce_to_modes
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: hold_bodies, held_modes, rigid_mass

  integer, parameter :: kept = 8                     !! modes of a body, besides its static shapes

  !> A body of a group by few modes and static shapes.
  type, public :: held_body_model
    integer :: number = 0                            !! of the body
    integer :: before = 0                            !! unknowns of the group before it
    type(body_model) :: b
    real(wp), allocatable :: rows(:, :)              !! (rows, 3 + nf) of joints, by its unknowns [-], [m]
  end type held_body_model

contains

  !> Reduces the bodies of a group, with the rows of their joints.
  subroutine hold_bodies(m, numbers, joints, members, ok)
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: numbers(:)                !! of the bodies
    type(triplet_matrix), intent(in) :: joints       !! (rows, nq) [-], [m]
    type(held_body_model), allocatable, intent(out) :: members(:)
    logical, intent(out) :: ok
    integer, allocatable :: mine(:), active(:)       ! entries of a body; rows that act on the group
    real(wp), allocatable :: rows(:, :)
    logical :: acts(m%s%rows)
    logical :: bad
    integer :: k, e, n
    allocate (members(size(numbers)))
    acts = .false.
    do k = 1, merge(size(numbers), 0, joints%count > 0)
      associate (i => m%s%qo(numbers(k)), b => m%s%bodies(numbers(k)))
        mine = pack([(e, e=1, joints%count)], joints%cols(:joints%count) > i .and. joints%cols(:joints%count) <= i + 3 + b%nf)
        acts(joints%rows(mine)) = .true.
      end associate
    end do
    active = pack([(k, k=1, size(acts))], acts)
    n = 0
    ok = .true.
    do k = 1, size(numbers)
      associate (x => members(k), i => m%s%qo(numbers(k)))
        x%number = numbers(k)
        x%before = n
        x%b = m%s%bodies(numbers(k))
        allocate (rows(size(acts), 3 + x%b%nf), source=0.0_wp)
        do e = 1, joints%count
          if (joints%cols(e) <= i .or. joints%cols(e) > i + 3 + x%b%nf) cycle
          rows(joints%rows(e), joints%cols(e) - i) = rows(joints%rows(e), joints%cols(e) - i) + joints%values(e)
        end do
        rows = rows(active, :)
        if (x%b%basis%reduced_from == 0) then
          deallocate (x%b%basis)
          call reduce_to_modes(x%b, min(kept, x%b%nf), .true., pack([(e, e=1, x%b%nf)], &
                                                                    any(abs(rows(:, 4:)) > 0.0_wp, 1)), bad)
          ok = ok .and. .not. bad
          if (bad) return
          select type (basis => x%b%basis)
          type is (modal_model)
            rows = reshape([rows(:, :3), matmul(rows(:, 4:), basis%psi(1:, :))], [size(active), 3 + x%b%nf])
          end select
        end if
        call move_alloc(rows, x%rows)
        n = n + 3 + x%b%nf
      end associate
    end do
  end subroutine hold_bodies

  !> Modes that bend, of a group on its joints, mass-normalised and ascending; none where the equations have none.
  subroutine held_modes(members, omega2, x)
    type(held_body_model), intent(in) :: members(:)
    real(wp), allocatable, intent(out) :: omega2(:)  !! [rad2/s2]
    real(wp), allocatable, intent(out) :: x(:, :)    !! (unknowns, modes) [m, rad, over kg^.5 m]
    real(wp), allocatable :: m(:, :), k(:, :), z(:, :), w(:), work(:), rows(:, :), rigid(:, :)
    integer, allocatable :: iwork(:)
    integer :: j, n, free, info
    n = members(size(members))%before + 3 + members(size(members))%b%nf
    allocate (m(n, n), k(n, n), rows(size(members(1)%rows, 1), n), source=0.0_wp)
    allocate (rigid(size(rows, 1), 3*size(members)))
    do j = 1, size(members)
      associate (i => members(j)%before, nf => members(j)%b%nf)
        call fill_matrices(members(j)%b, m(i + 1:i + 3 + nf, i + 1:i + 3 + nf), k(i + 1:i + 3 + nf, i + 1:i + 3 + nf))
        rows(:, i + 1:i + 3 + nf) = members(j)%rows
        rigid(:, 3*j - 2:3*j) = members(j)%rows(:, :3)/spread([1.0_wp, 1.0_wp, members(j)%b%length], 1, size(rows, 1))
      end associate
    end do
    free = size(rigid, 2) - rank_of(rigid)           ! motions of the group as rigid bodies
    call null_space(rows, [(1/sqrt(m(j, j)), j=1, n)], z)
    n = size(z, 2)
    allocate (w(n), work(1 + 6*n + 2*n*n), iwork(3 + 5*n), omega2(0), x(size(z, 1), 0))
    if (n <= free) return
    k = matmul(transpose(z), matmul(k, z))
    m = matmul(transpose(z), matmul(m, z))
    call dsygvd(1, 'V', 'U', n, k, n, m, n, w, work, size(work), iwork, size(iwork), info)
    if (info /= 0) return
    omega2 = w(free + 1:)
    x = matmul(z, k(:, free + 1:))
  end subroutine held_modes

  !> M and K of a body's frame and elastic coordinates, at rest and undeformed.
  pure subroutine fill_matrices(b, m, k)
    type(body_model), intent(in) :: b
    real(wp), intent(out) :: m(:, :)                 !! [kg, kg m, kg m2]
    real(wp), intent(out) :: k(:, :)                 !! [1/s2]
    real(wp) :: unit(b%nf)                           ! [kg^.5 m]
    integer :: j
    m = 0.0_wp
    k = 0.0_wp
    m(:3, :3) = rigid_mass(b)
    m(4:, 1:2) = b%shape%sbar
    m(4:, 3) = b%shape%c0
    m(:3, 4:) = transpose(m(4:, :3))
    do j = 1, b%nf
      unit = 0.0_wp
      unit(j) = 1.0_wp
      call mass_product(b%op, unit, m(4:, 3 + j))
      select type (basis => b%basis)
      type is (modal_model)
        k(3 + j, 3 + j) = basis%omega2(j)
      end select
    end do
  end subroutine fill_matrices

  !> Rank of a small matrix. Singular values would be found by divisions by zero, which the checked build traps.
  integer function rank_of(a) result(rank)
    real(wp), intent(in) :: a(:, :)                  !! [any]
    real(wp) :: c(size(a, 1), size(a, 2)), tau(min(size(a, 1), size(a, 2))), work(64*size(a, 2) + 64)   ! [any]
    integer :: pivots(size(a, 2)), info, j
    rank = 0
    if (size(tau) == 0) return
    c = a
    pivots = 0
    call dgeqp3(size(a, 1), size(a, 2), c, size(a, 1), pivots, tau, work, size(work), info)
    rank = count([(abs(c(j, j)) > half_digits*abs(c(1, 1)), j=1, size(tau))])
  end function rank_of

  !> Motions in units that the rows allow: the last columns of Q in P J^T = Q R.
  subroutine null_space(rows, unit, z)
    real(wp), intent(in) :: rows(:, :)               !! (rows, unknowns) [-], [m]
    real(wp), intent(in) :: unit(:)                  !! (unknowns) of each [1/sqrt(kg), 1/sqrt(kg) m]
    real(wp), allocatable, intent(out) :: z(:, :)    !! (unknowns, motions) [m, rad, over kg^.5 m]
    real(wp), allocatable :: a(:, :), tau(:), work(:)
    integer, allocatable :: pivots(:)
    integer :: n, nr, info, rank, j
    n = size(unit)
    nr = size(rows, 1)
    allocate (a(n, max(n, nr)), source=0.0_wp)
    allocate (tau(n), work(64*max(n, nr) + 64), pivots(nr))
    pivots = 0
    a(:, :nr) = transpose(rows)*spread(unit, 2, nr)
    rank = 0
    if (nr > 0) then
      call dgeqp3(n, nr, a, n, pivots, tau, work, size(work), info)
      rank = count([(abs(a(j, j)) > half_digits*abs(a(1, 1)), j=1, min(n, nr))])
    end if
    call dorgqr(n, n, rank, a, n, tau, work, size(work), info)
    z = a(:, rank + 1:n)*spread(unit, 2, n - rank)
  end subroutine null_space

  !> Mass of the frame's unknowns.
  pure function rigid_mass(b) result(m)
    type(body_model), intent(in) :: b
    real(wp) :: m(3, 3)                              !! [kg, kg m, kg m2]
    m = reshape([b%mass, 0.0_wp, -b%i1(2), 0.0_wp, b%mass, b%i1(1), -b%i1(2), b%i1(1), b%i11], [3, 3])
  end function rigid_mass
end module held_body
