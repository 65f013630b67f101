!> Orderings that keep sparse symmetric matrices in a narrow band.
module ordering
  implicit none (type, external)
  private
  public :: reverse_cuthill_mckee, adjacency

contains

  !> Reverse Cuthill-McKee order, connected component by connected component (Cuthill & McKee 1969). A chain that is
  !> already in order stays in order.
  subroutine reverse_cuthill_mckee(n, rows, cols, order, block_start)
    integer, intent(in) :: n                            !! number of vertices
    integer, intent(in) :: rows(:), cols(:)             !! edges; loops and duplicates are ignored
    integer, allocatable, intent(out) :: order(:)       !! (n) order(k): vertex at position k
    integer, allocatable, intent(out) :: block_start(:) !! (components+1) first position of each component, then n+1
    integer, allocatable :: first(:), neighbour(:), starts(:)
    logical, allocatable :: done(:)
    integer :: k, root, count, blocks
    call adjacency(n, rows, cols, first, neighbour)
    allocate (order(n), starts(n + 1), done(n))
    done = .false.
    count = 0
    blocks = 0
    do k = 1, n
      if (done(k)) cycle
      blocks = blocks + 1
      starts(blocks) = count + 1
      root = last_level_vertex(k, first, neighbour, n)     ! two searches find a vertex at one end (George & Liu)
      root = last_level_vertex(root, first, neighbour, n)
      call visit(root, first, neighbour, done, order, count)
      if (order(count) < order(starts(blocks))) order(starts(blocks):count) = order(count:starts(blocks):-1)   ! as given
    end do
    starts(blocks + 1) = n + 1
    block_start = starts(1:blocks + 1)
  end subroutine reverse_cuthill_mckee

  !> Compressed adjacency lists without loops or duplicates.
  subroutine adjacency(n, rows, cols, first, neighbour)
    integer, intent(in) :: n, rows(:), cols(:)
    integer, allocatable, intent(out) :: first(:)       !! (n+1) start of each vertex's list
    integer, allocatable, intent(out) :: neighbour(:)   !! the lists
    integer, allocatable :: raw(:), start(:), mark(:), fill(:)
    integer :: k, i, j, m
    allocate (start(n + 1), fill(n), mark(n))
    start = 0
    do k = 1, size(rows)
      if (rows(k) == cols(k)) cycle
      start(rows(k) + 1) = start(rows(k) + 1) + 1
      start(cols(k) + 1) = start(cols(k) + 1) + 1
    end do
    start(1) = 1
    do k = 1, n
      start(k + 1) = start(k + 1) + start(k)
    end do
    allocate (raw(start(n + 1) - 1))
    fill = start(1:n)
    do k = 1, size(rows)
      i = rows(k)
      j = cols(k)
      if (i == j) cycle
      raw(fill(i)) = j
      fill(i) = fill(i) + 1
      raw(fill(j)) = i
      fill(j) = fill(j) + 1
    end do
    allocate (first(n + 1), neighbour(size(raw)))
    mark = 0
    m = 0
    do k = 1, n
      first(k) = m + 1
      do i = start(k), start(k + 1) - 1
        j = raw(i)
        if (mark(j) == k) cycle
        mark(j) = k
        m = m + 1
        neighbour(m) = j
      end do
    end do
    first(n + 1) = m + 1
    neighbour = neighbour(1:m)
  end subroutine adjacency

  !> The vertex of least degree in the last level of a breadth-first search.
  integer function last_level_vertex(root, first, neighbour, n) result(vertex)
    integer, intent(in) :: root, first(:), neighbour(:), n
    integer, allocatable :: queue(:), level(:)
    integer :: head, tail, k, i
    allocate (queue(n), level(n))
    level = -1
    queue(1) = root
    level(root) = 0
    head = 1
    tail = 1
    do while (head <= tail)
      i = queue(head)
      head = head + 1
      do k = first(i), first(i + 1) - 1
        if (level(neighbour(k)) >= 0) cycle
        level(neighbour(k)) = level(i) + 1
        tail = tail + 1
        queue(tail) = neighbour(k)
      end do
    end do
    vertex = queue(tail)
    do k = tail, 1, -1
      i = queue(k)
      if (level(i) < level(queue(tail))) exit
      if (first(i + 1) - first(i) <= first(vertex + 1) - first(vertex)) vertex = i
    end do
  end function last_level_vertex

  !> Breadth-first order from a root, neighbours by ascending degree.
  subroutine visit(root, first, neighbour, done, order, count)
    integer, intent(in) :: root, first(:), neighbour(:)
    logical, intent(inout) :: done(:)
    integer, intent(inout) :: order(:), count
    integer :: head, k, i, j, from
    head = count + 1
    count = count + 1
    order(count) = root
    done(root) = .true.
    do while (head <= count)
      i = order(head)
      head = head + 1
      from = count + 1
      do k = first(i), first(i + 1) - 1
        if (done(neighbour(k))) cycle
        done(neighbour(k)) = .true.
        count = count + 1
        order(count) = neighbour(k)
        do j = count, from + 1, -1
          if (degree(order(j)) >= degree(order(j - 1))) exit
          order([j - 1, j]) = order([j, j - 1])
        end do
      end do
    end do
  contains
    !> Number of neighbours.
    pure integer function degree(v)
      integer, intent(in) :: v
      degree = first(v + 1) - first(v)
    end function degree
  end subroutine visit
end module ordering
